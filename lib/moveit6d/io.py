"""Files that appear whole or not at all, and JSON.

Never knows what the content means.
"""

from __future__ import annotations

import json
import math
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .errors import InputError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A temporary name beside `path`, which takes its place when the block ends without an error.

    Makes the folder if it is missing. After an error the temporary file is removed and an older
    file at `path` stays as it was. `InputError` if nothing can be written there.

    Examples:
        >>> from pathlib import Path
        >>> with replacing(Path("figures.txt")) as temporary:
        ...     _ = temporary.write_text("42")
        >>> Path("figures.txt").read_text()
        '42'
    """
    temporary = path.with_name(f".{path.stem}.{os.getpid()}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        if path.is_dir():
            raise InputError(f"{path} is a folder; a file of that name was to be written.")
        try:
            yield temporary
        except BaseException:
            temporary.unlink(missing_ok=True)
            raise
        os.replace(temporary, path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from error


@contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """A new folder beside `path`, which takes its place when the block ends without an error.

    After an error the new folder is removed and an older one at `path` stays as it was.
    """
    work = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        work.mkdir(parents=True)
        yield work
        if path.exists():
            shutil.rmtree(path)
        os.replace(work, path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)


def write_json(path: Path, content: Mapping[str, Any]) -> None:
    """Write one JSON object, atomically. Numbers that are not finite become null.

    >>> write_json(Path("a.json"), {"mean": math.nan, "frames": 3})
    >>> read_json(Path("a.json"))
    {'mean': None, 'frames': 3}
    """
    text = json.dumps(_finite(content), indent=2, allow_nan=False)
    with replacing(path) as temporary:
        temporary.write_text(text + "\n", encoding="utf-8")


def read_json(path: Path) -> dict[str, Any]:
    """Read one JSON object; `InputError` for a missing file or anything else in it."""
    content = _json(path)
    if not isinstance(content, dict):
        raise InputError(f"{path} must hold one JSON object in braces.")
    return content


def read_json_list(path: Path) -> list[Any]:
    """Read one JSON list; `InputError` for a missing file or anything else in it."""
    content = _json(path)
    if not isinstance(content, list):
        raise InputError(f"{path} must hold one JSON list in brackets.")
    return content


def _json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise InputError(f"{path} does not exist.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    except (json.JSONDecodeError, UnicodeDecodeError) as error:
        raise InputError(f"{path} is not a JSON file: {error}.") from error


def _finite(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
