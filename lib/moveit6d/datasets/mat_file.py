"""Named arrays of numbers from MATLAB's MAT files (version 5), as YCB-Video has them.

Never reads cells, structures, objects, text or sparse arrays: what else a file holds is passed
over. SciPy's reader runs compiled code on whatever stands in a damaged file and can take the
process with it; this one checks every length. Format: MathWorks, "MAT-File Format", version 5.
"""

from __future__ import annotations

import struct
import zlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

TYPES = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 9: "f8", 12: "i8", 13: "u8"}
MATRIX, COMPRESSED = 14, 15
NUMERIC = range(6, 16)  # classes of full arrays of numbers
COMPLEX = 0x08
HEAD = 128  # bytes
LARGEST = 1 << 30  # bytes that a compressed array may unfold to
FIRST = 512  # bytes of a compressed array that are enough for its name


class _Damaged(Exception):
    """A length that does not fit."""


def read_mat(path: Path, names: tuple[str, ...]) -> dict[str, NDArray[np.generic]]:
    """Those of the named arrays that the file has; `InputError` if it is damaged."""
    try:
        content = path.read_bytes() if path.is_file() else b""
    except OSError as error:
        raise InputError(f"{path} cannot be read: {error.strerror or error}.") from error
    order = {b"IM": "<", b"MI": ">"}.get(content[126:128])
    if order is None:
        raise InputError(f"{path} is not a readable MAT file: it has no header of version 5.")
    found: dict[str, NDArray[np.generic]] = {}
    try:
        for kind, body in _elements(content[HEAD:], order):
            name, array = _named(kind, body, order, names)
            if array is not None:
                found[name] = array
    except (_Damaged, struct.error, zlib.error, ValueError) as error:
        raise InputError(f"{path} is not a readable MAT file: {error or 'damaged'}.") from error
    return found


def _elements(content: bytes, order: str) -> Iterator[tuple[int, bytes]]:
    """Type and bytes of the elements that follow each other."""
    place = 0
    while place + 8 <= len(content):
        kind, size = struct.unpack_from(order + "II", content, place)
        if kind >> 16:  # the small form: type, size and up to four bytes in eight
            kind, size = kind & 0xFFFF, kind >> 16
            if size > 4:
                raise _Damaged("a small element is too long")
            yield kind, content[place + 4 : place + 4 + size]
            place += 8
            continue
        if place + 8 + size > len(content):
            raise _Damaged("it is cut off")
        yield kind, content[place + 8 : place + 8 + size]
        place += 8 + size + (0 if kind == COMPRESSED else -size % 8)


def _named(
    kind: int, body: bytes, order: str, names: tuple[str, ...]
) -> tuple[str, NDArray[np.generic] | None]:
    """The name of an array and, if it is wanted, its numbers."""
    if kind == COMPRESSED:
        start = zlib.decompressobj().decompress(body, FIRST)
        if _name(start[8:], order) not in names:
            return "", None
        unfolding = zlib.decompressobj()
        whole = unfolding.decompress(body, LARGEST)
        if unfolding.unconsumed_tail:
            raise _Damaged("an array is too large")
        for inner, content in _elements(whole, order):
            return _named(inner, content, order, names)
        raise _Damaged("an array is empty")
    if kind != MATRIX:
        return "", None
    name = _name(body, order)
    return name, _numbers(body, order) if name in names else None


def _name(body: bytes, order: str) -> str:
    """The name in the first parts of an array: flags, sizes, name."""
    try:
        for index, (_, content) in enumerate(_elements(body, order)):
            if index == 2:
                return content.decode("latin-1")
    except _Damaged:
        pass
    return ""


def _numbers(body: bytes, order: str) -> NDArray[np.generic] | None:
    parts = list(_elements(body, order))
    if len(parts) < 4:
        raise _Damaged("an array has no numbers")
    flags = struct.unpack(order + "I", parts[0][1][:4])[0]
    if flags & 0xFF not in NUMERIC or flags >> 8 & COMPLEX:
        return None
    shape = struct.unpack(f"{order}{len(parts[1][1]) // 4}i", parts[1][1])
    kind, content = parts[3]
    if kind not in TYPES:
        raise _Damaged("an array has numbers of an unknown type")
    values = np.frombuffer(content, order + TYPES[kind])
    if min(shape, default=0) < 0 or int(np.prod(shape, dtype=object)) != len(values):
        raise _Damaged("an array's sizes do not fit its numbers")
    return values.astype(values.dtype.newbyteorder("=")).reshape(shape, order="F")
