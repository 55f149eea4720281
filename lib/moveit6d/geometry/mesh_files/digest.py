"""The files that make a mesh's looks: itself, what it names, its symmetries; and their fingerprint.

Never reads a mesh: what a machine decodes may differ in the last bit, the files do not.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

from .beside import decoded, find_beside, read_bytes

# Materials, buffers and pictures; what ends so is looked for, whatever the format means by it.
NAMED = re.compile(
    rb"\.(mtl|bin|png|jpe?g|jp2|bmp|tga|tiff?|webp|gif|p[pgn]m|dds|avif|ktx2)\b", re.IGNORECASE
)
TEXTS = (".obj", ".mtl")  # the others that name files do it in ASCII or UTF-8
LONGEST_NAME = 300  # bytes
AROUND_NAMES = re.compile(rb"[\r\n\"<>\0]")


def mesh_digest(path: Path) -> str:
    """SHA-256 of a mesh file, of the files that it names, and of symmetries beside it.

    The same wherever the same files lie.
    """
    whole = hashlib.sha256()
    for one in files_of_mesh(path):
        whole.update(hashlib.sha256(read_bytes(one)).digest())
    return whole.hexdigest()


def files_of_mesh(path: Path) -> list[Path]:
    """A mesh file, the files that it names, and those of symmetries beside it; the mesh first."""
    own = find_beside(path, f"{path.stem}.mtl")  # also where an OBJ file names none
    files = dict.fromkeys([path, *_named(path, path), *([own] if own else [])])
    for library in [one for one in files if one.suffix.lower() == ".mtl"]:
        files |= dict.fromkeys(_named(library, path))
    return list(files | dict.fromkeys(_symmetries(path)))


def _named(file: Path, mesh: Path) -> Iterator[Path]:
    """The files that one names, beside it or beside the mesh, in their order in it."""
    content = read_bytes(file)
    if file.suffix.lower() in TEXTS:  # of any encoding
        content = decoded(content).encode("utf-8", errors="replace")
    ends = (ending.end() for ending in NAMED.finditer(content))
    lines = (AROUND_NAMES.split(content[max(0, end - LONGEST_NAME) : end])[-1] for end in ends)
    for line in dict.fromkeys(lines):
        words = re.split(r"[ \t]", decoded(line))
        # A name may hold spaces, and stand behind a keyword and options.
        for first in range(len(words)):
            name = " ".join(words[first:])
            found = find_beside(file, name) or find_beside(mesh, name)
            if found is not None:
                yield found
                break


def _symmetries(mesh: Path) -> list[Path]:
    """The files in which `geometry.symmetry_file` looks."""
    places = [
        place
        for file in (mesh, mesh.resolve())
        for place in (file.with_suffix(".symmetry.json"), file.with_name("models_info.json"))
    ]
    return [place for place in places if place.is_file()]
