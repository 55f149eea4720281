"""The files that a mesh file names: found beside it however the name was written.

Never opens anything outside of the mesh file's own folder, and of that of the file a link leads to.
"""

from __future__ import annotations

import os
import re
import unicodedata
from pathlib import Path, PurePosixPath
from urllib.parse import unquote

from ...errors import InputError

HEAD = 4096  # bytes that tell the encoding of a text
LARGEST = 4 * 2**30  # bytes; nothing larger is read


def find_beside(file: Path, name: str) -> Path | None:
    """The file that `name` means beside `file` that names it; None where there is none.

    Understands quotes, backslashes, `%20`, `file://`, another letter case and another Unicode form.
    Where the folders in the name do not exist (those of another machine), the bare file name is
    looked for beside the mesh file. Beside a symbolic link first, then beside what it leads to.
    """
    found = _find(file.parent, name)
    return _find(file.resolve().parent, name) if found is None and file.is_symlink() else found


def _find(folder: Path, name: str) -> Path | None:
    for spelling in _spellings(name):
        path = PurePosixPath(spelling)
        inside = not path.is_absolute() and ".." not in path.parts
        for parts in ([path.parts] if inside else []) + [path.parts[-1:]]:
            found = _walk(folder, [part for part in parts if part != "."])
            if found is not None:
                return found
    return None


def read_bytes(path: Path) -> bytes:
    """A whole regular file; `InputError` for anything else (a pipe would never end)."""
    try:
        if path.exists() and not path.is_file():
            raise InputError(f"{path} is not a regular file.")
        if path.stat().st_size > LARGEST:
            raise InputError(f"{path} is larger than 4 GB; reduce the mesh.")
        return path.read_bytes()
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error


def decoded(content: bytes) -> str:
    """Text of any common encoding: UTF-8 and UTF-16 with or without mark, else Latin-1."""
    if content.startswith((b"\xff\xfe", b"\xfe\xff")):
        return content.decode("utf-16", errors="replace")
    # Every other byte of UTF-16 is NUL as far as its text is ASCII; other text has none.
    even, odd = content[:HEAD:2].count(0), content[1:HEAD:2].count(0)
    if max(even, odd) > max(len(content[:HEAD]) / 4, 8 * min(even, odd)):
        return content.decode("utf-16-le" if odd > even else "utf-16-be", errors="replace")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError:
        return content.decode("latin-1")


def _spellings(name: str) -> list[str]:
    """Readings of a name as a POSIX path, the most literal first."""
    name = name.strip().strip("\0").strip()
    if len(name) > 1 and name[0] == name[-1] and name[0] in "\"'":
        name = name[1:-1].strip()
    literal = re.sub(r"^file:(//)?", "", name)
    slashes = re.sub(r"^[A-Za-z]:", "", literal.replace("\\", "/"))
    found = [literal, re.sub(r"\\(?=[ #])", "", literal), slashes, unquote(slashes)]
    return [text for text in dict.fromkeys(found) if text and "\0" not in text and len(text) < 4096]


def _walk(folder: Path, parts: list[str]) -> Path | None:
    """The file below a folder, each part in its own spelling or else in another letter case."""
    if not parts:
        return None
    place = folder
    for part in parts:
        exact = place / part
        try:
            there = exact.exists()
        except OSError:  # too long a name
            return None
        if not there:
            try:
                names = {_folded(entry): entry for entry in sorted(os.listdir(place))}
            except OSError:
                return None
            if _folded(part) not in names:
                return None
            exact = place / names[_folded(part)]
        place = exact
    return place if place.is_file() else None


def _folded(name: str) -> str:
    return unicodedata.normalize("NFC", name).casefold()
