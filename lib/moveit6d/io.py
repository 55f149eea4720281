"""Files that appear whole or not at all, and JSON.

Never knows what the content means.
"""

from __future__ import annotations

import codecs
import glob
import hashlib
import io
import json
import math
import os
import shutil
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from pathlib import Path
from typing import Any

from .errors import InputError

LARGEST_TEXT = 512 * 2**20  # bytes
IS_READ = "this run reads"  # why an input must stay
PROCESSES = 2**22 + 1  # numbers of processes are below; a user's date (.set.20260131) is not


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
        _sweep(path.parent, path.stem, path.suffix)
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


def discard(place: AbstractContextManager[Path]) -> None:
    """End a `replacing` that was entered by hand: nothing appears, an older file stays."""
    nothing = InputError("there is nothing to write.")
    with suppress(InputError):
        place.__exit__(type(nothing), nothing, None)


def write_all(file: io.RawIOBase, data: bytes) -> None:
    """Write to a file without a buffer, which a killed process would take along.

    A disk that is nearly full takes a part of it without an error: the rest is tried again.
    """
    while data:
        data = data[file.write(data) or 0 :]


def check_writable(path: Path) -> None:
    """`InputError`, before any long work, where a file at `path` could not be written."""
    with _said_of(path):
        taken = path.is_dir()
        if not taken:
            _probe(path.parent)
    if taken:
        raise InputError(f"{path} is a folder; a file of that name was to be written.")


def check_folder(path: Path) -> None:
    """`InputError`, before any long work, where no file could be written in a folder.

    Makes it if it is missing.
    """
    with _said_of(path):
        _probe(path)


@contextmanager
def _said_of(path: Path) -> Iterator[None]:
    try:
        yield
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"{path} cannot be written: {reason}.") from error


def _probe(folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    probe = folder / f".{os.getpid()}.probe"
    probe.touch()
    probe.unlink()


def check_places(
    written: Mapping[str, Iterable[Path | None]],
    taken: Mapping[Path, str],
    folders: Iterable[Path] = (),
) -> None:
    """`InputError` where a file of an option would take the place of another one of the run.

    `written` are the options with their files, or with a folder that is replaced by a new one;
    `taken` are files with the reason why they must stay; so must every file in `folders`.
    """
    kept: dict[Path, str] = {}
    for path, why in taken.items():
        _keep(kept, path, why)
    inputs = [folder.resolve() for folder in folders]
    for option, paths in written.items():
        given = [path for path in paths if path is not None]
        for path in given:
            place = path.resolve()
            inside = place.is_file() and any(folder in place.parents for folder in inputs)
            reason = kept.get(place, IS_READ if inside else None)
            if reason is not None:
                raise InputError(
                    f"{option}: {path} would be replaced, which {reason}; give another name."
                )
        for path in given:
            _keep(kept, path, f"{option} writes")


def _keep(kept: dict[Path, str], path: Path, why: str) -> None:
    """Nothing may be written at a path, nor where a folder around it is."""
    place = path.resolve()
    for one in (place, *place.parents):
        kept.setdefault(one, why)


def file_digest(path: Path) -> str:
    """SHA-256 of a file."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


def _sweep(folder: Path, stem: str, suffix: str = "") -> None:
    """Remove temporary files and folders that processes left which were killed an hour ago or more.

    Younger ones may belong to another machine that writes to the same folder.
    """
    for left in folder.glob(f".{glob.escape(stem)}.*{glob.escape(suffix)}"):
        number = left.name[len(stem) + 2 : len(left.name) - len(suffix)]
        if not (number.isdecimal() and int(number) < PROCESSES):
            continue
        with suppress(OSError):
            if time.time() - _last_change(left) > 3600 and not _runs(int(number)):
                _remove(left)


def _last_change(path: Path) -> float:
    """When a file, or anything in a folder, was written last."""
    inside = path.rglob("*") if path.is_dir() else ()
    times: list[float] = [one.lstat().st_mtime for one in (path, *inside)]
    return max(times)


def _remove(path: Path) -> None:
    """Remove a file or a whole folder, if it is there."""
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True


@contextmanager
def replacing_folder(path: Path) -> Iterator[Path]:
    """A new folder beside `path`, which takes its place when the block ends without an error.

    After an error the new folder is removed and an older one at `path` stays as it was.
    """
    work = path.with_name(f".{path.name}.{os.getpid()}")
    try:
        _sweep(path.parent, path.name)
        _remove(work)  # in a container a killed run may have had the same number
        work.mkdir(parents=True)
        yield work
        if path.exists():
            shutil.rmtree(path)
        os.replace(work, path)
    except OSError as error:
        raise InputError(f"{path} cannot be written: {error.strerror or error}.") from error
    finally:
        shutil.rmtree(work, ignore_errors=True)


def refuse_foreign(folder: Path, foreign: Sequence[str], what: str) -> None:
    """`InputError` where a folder, to be replaced, holds these files beside what was made here."""
    if foreign:
        more = f" and {len(foreign) - 4} more" if len(foreign) > 4 else ""
        raise InputError(
            f"{folder} holds {', '.join(foreign[:4])}{more} beside {what} made here, which would "
            "be removed with it; give a new folder."
        )


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


def read_text(path: Path) -> str:
    """A text file in UTF-8, with or without a mark, or in UTF-16 with one.

    `InputError` for anything else.
    """
    try:
        if path.is_dir():
            raise InputError(f"{path} is a folder; give a file.")
        if path.exists() and not path.is_file():  # a pipe would never end
            raise InputError(f"{path} is not a regular file.")
        if path.stat().st_size > LARGEST_TEXT:
            raise InputError(f"{path} is larger than {LARGEST_TEXT >> 20} MB; that is no text.")
        content = path.read_bytes()
        if content.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):  # as PowerShell writes
            return content.decode("utf-16")
        return io.TextIOWrapper(io.BytesIO(content), encoding="utf-8-sig").read()
    except InputError:  # a ValueError, too
        raise
    except FileNotFoundError:
        raise InputError(f"{path} does not exist.") from None
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    except ValueError as error:  # neither encoding, or a path with a zero byte
        raise InputError(f"{path} is not a text file: {str(error)[:120]}.") from error


def _json(path: Path) -> Any:
    text = read_text(path)
    try:
        return json.loads(text)
    except RecursionError:
        raise InputError(f"{path} is not a JSON file: it is nested too deeply.") from None
    except ValueError as error:  # its integers may also have too many digits
        raise InputError(f"{path} is not a JSON file: {str(error)[:120]}.") from error


def _finite(value: Any) -> Any:
    if isinstance(value, float) and not math.isfinite(value):
        return None
    if isinstance(value, Mapping):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return value
