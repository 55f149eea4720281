"""Values that came from files, checked: numbers, whole numbers, lists, objects, names.

Never reads a file; each function says in one sentence where something else stood.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .errors import InputError

# What readers run into when a file holds something else than it should.
DAMAGE = (
    KeyError, TypeError, ValueError, AttributeError, IndexError, OverflowError, RecursionError,
    AssertionError, EOFError, ZeroDivisionError,
)  # fmt: skip
LARGEST_WHOLE = 2**53  # beyond it floats, and so JSON's numbers, are no longer exact


@contextmanager
def reading(path: Path | str, what: str = "") -> Iterator[None]:
    """Turn whatever a reader stumbles upon into an `InputError` that names the file."""
    try:
        yield
    except InputError:
        raise
    except DAMAGE as error:
        reason = " ".join(str(error).split())[:120]
        kind = f"no {reason}" if isinstance(error, KeyError) else reason or type(error).__name__
        raise InputError(
            f"{path} cannot be read{f' as {what}' if what else ''}: {kind}."
        ) from error


def number(value: Any, where: str) -> float:
    """A finite number."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise InputError(f"{where} must be a number, found {shown(value)}.")
    try:
        found = float(value)
    except OverflowError:
        found = math.inf
    if not math.isfinite(found):
        raise InputError(f"{where} must be a finite number, found {shown(value)}.")
    return found


def whole(value: Any, where: str) -> int:
    """A whole number, also one that is written as 3.0."""
    found = number(value, where)
    if not found.is_integer() or abs(found) > LARGEST_WHOLE:
        raise InputError(f"{where} must be a whole number, found {shown(value)}.")
    return int(found)


def numbers(value: Any, count: int | None, where: str) -> list[float]:
    """A flat list of so many finite numbers (any number of them with None)."""
    found = listed(value, where)
    if count is not None and len(found) != count:
        raise InputError(f"{where} must be {count} numbers, found {len(found)}.")
    return [number(one, where) for one in found]


def listed(value: Any, where: str) -> list[Any]:
    """A list."""
    if not isinstance(value, list | tuple):
        raise InputError(f"{where} must be a list, found {shown(value)}.")
    return list(value)


def mapping(value: Any, where: str) -> dict[str, Any]:
    """A JSON object."""
    if not isinstance(value, dict):
        raise InputError(f"{where} must be a JSON object in braces, found {shown(value)}.")
    return value


def entry(value: dict[str, Any], key: str, where: str) -> Any:
    """An entry that must be there."""
    if key not in value:
        raise InputError(f"{where} has no {key}.")
    return value[key]


def file_name(name: str, where: str) -> str:
    """A name from a data set that will become part of a file's name: it may not name a folder."""
    bad = not name or name.startswith(".") or len(name.encode(errors="replace")) > 200
    if bad or any(character in '/\\:*?"<>|' or ord(character) < 32 for character in name):
        raise InputError(f"{where}: {shown(name)} cannot be a name, as files are called by it.")
    return name


def shown(value: Any) -> str:
    """A value for an error message, shortened."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits
        text = type(value).__name__
    return text if len(text) <= 60 else f"{text[:57]}…"
