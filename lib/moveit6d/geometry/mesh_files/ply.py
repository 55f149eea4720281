"""PLY: the elements of a file, ASCII and binary, and its faces.

Never reads edges, tristrips are unrolled. Format: Greg Turk, "The PLY polygon file format", and
what MeshLab, Meshroom, Open3D and BOP's tools write.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .beside import read_bytes
from .content import MeshContent
from .ply_looks import PlyShape, add_parts
from .polygons import triangulated

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
INDEX_NAMES = ("vertex_indices", "vertex_index")

Lists = tuple[NDArray[np.int64], NDArray[Any]]  # lengths, and all values behind each other


@dataclass
class Element:
    """An element of the header: its properties as (name, type, type of the length or None)."""

    name: str
    count: int
    properties: list[tuple[str, str, str | None]] = field(default_factory=list)


@dataclass
class Header:
    """What stands before the numbers."""

    order: str  # "" for ASCII
    elements: list[Element]
    textures: list[str]
    end: int  # where the numbers begin


def read_ply(content: MeshContent) -> None:
    """Add the parts of a PLY file to `content`."""
    data = read_bytes(content.path)
    header = _header(data, content)
    read = _ascii if header.order == "" else _binary
    tables = read(data, header, content)
    vertex, face = tables.get("vertex", {}), tables.get("face", {})
    if not {"x", "y", "z"} <= set(vertex):
        raise InputError(f"{content.path}: holds no vertices with x, y and z.")
    points = np.stack([vertex[axis].astype(np.float64) for axis in "xyz"], -1)
    lists = next((face[name] for name in INDEX_NAMES if name in face), None)
    if lists is None and "tristrips" in tables:
        lists = _from_tristrips(next(iter(tables["tristrips"].values())))
    if lists is None or not len(lists[0]):
        raise InputError(f"{content.path}: holds no faces; a mesh of triangles is needed.")
    counts, corners = lists[0], lists[1].astype(np.int64)
    triangles, polygon = triangulated(corners, counts, points, content.path)
    shape = PlyShape(points, corners, counts, triangles, polygon)
    add_parts(content, shape, tables, header.textures)


def _header(data: bytes, content: MeshContent) -> Header:
    where = content.path
    if data[:3].lower() != b"ply":
        raise InputError(f"{where}: cannot be read as a mesh (it does not begin with 'ply').")
    at = data.find(b"end_header")
    newline = data.find(b"\n", at)
    if at < 0 or at > 1 << 20:
        raise InputError(f"{where} is cut off or damaged: its header has no end.")
    end = newline + 1 if newline >= 0 else len(data)
    if newline < 0 or (0 <= data.find(b"\r", at) < newline - 1):  # lines end in CR alone
        end = data.find(b"\r", at) + 1 or len(data)
    order, elements, textures = None, [], []
    for line in data[:at].decode("latin-1").splitlines():
        words = line.split()
        if words[:1] == ["format"] and len(words) > 1:
            order = ORDERS.get(words[1])
        elif words[:2] == ["comment", "TextureFile"] or words[:1] == ["TextureFile"]:
            raw = line.split("TextureFile", 1)[1].strip()
            textures.append(raw.encode("latin-1").decode("utf-8", errors="replace"))
        elif words[:1] == ["element"] and len(words) == 3 and words[2].isdecimal():
            elements.append(Element(words[1], int(words[2][:18])))
        elif words[:1] == ["property"] and elements:
            elements[-1].properties.append(_property(words, where))
    if order is None:
        raise InputError(f"{where}: its header names no format (ascii or binary).")
    return Header(order, elements, textures, end)


def _property(words: list[str], where: Any) -> tuple[str, str, str | None]:
    if len(words) == 5 and words[1] == "list" and words[2] in TYPES and words[3] in TYPES:
        return words[4], TYPES[words[3]], TYPES[words[2]]
    if len(words) == 3 and words[1] in TYPES:
        return words[2], TYPES[words[1]], None
    raise InputError(f"{where}: its header has the line {' '.join(words)[:60]!r}, not understood.")


def _ascii(data: bytes, header: Header, content: MeshContent) -> dict[str, dict[str, Any]]:
    """All elements, each as columns by property name."""
    tokens = np.array(data[header.end :].split())
    try:
        numbers = tokens.astype(np.float64)
    except ValueError as error:
        raise InputError(f"{content.path} is damaged: {str(error)[:80]}.") from error
    tables, place = {}, 0
    for element in header.elements:
        table, place = _rows(numbers, place, element, content)
        tables[element.name] = table
    return tables


def _rows(
    numbers: NDArray[np.float64], place: int, element: Element, content: MeshContent
) -> tuple[dict[str, Any], int]:
    kinds = element.properties
    if all(length is None for _, _, length in kinds):
        end = place + element.count * len(kinds)
        if end > len(numbers):
            raise _cut_off(content, element)
        rows = numbers[place:end].reshape(element.count, len(kinds))
        return {name: rows[:, k].astype(kind) for k, (name, kind, _) in enumerate(kinds)}, end
    if len(kinds) == 1 and element.count and place < len(numbers):
        width = 1 + max(int(min(numbers[place], len(numbers))), 0)
        block = numbers[place : place + element.count * width]
        if len(block) == element.count * width and (block[::width] == width - 1).all():
            flat = block.reshape(-1, width)[:, 1:].reshape(-1).astype(kinds[0][1])
            counts = np.full(element.count, width - 1, np.int64)
            return {kinds[0][0]: (counts, flat)}, place + len(block)
    found: dict[str, list[Any]] = {name: [] for name, _, _ in kinds}
    values = numbers.tolist()
    for _ in range(element.count):
        for name, _, length in kinds:
            size = 1
            if length is not None:
                if place >= len(values) or not 0 <= values[place] <= len(values):
                    raise _cut_off(content, element)
                size, place = int(values[place]), place + 1
            if place + size > len(values):
                raise _cut_off(content, element)
            found[name].append(values[place : place + size])
            place += size
    return {name: _column(found[name], kind, length) for name, kind, length in kinds}, place


def _column(rows: list[Any], kind: str, length: str | None) -> Any:
    flat = np.array([value for row in rows for value in row], np.float64).astype(kind)
    return flat if length is None else (np.array([len(row) for row in rows], np.int64), flat)


def _binary(data: bytes, header: Header, content: MeshContent) -> dict[str, dict[str, Any]]:
    tables, place = {}, header.end
    for element in header.elements:
        kinds = element.properties
        if not any(length for _, _, length in kinds):
            kind = np.dtype([(name, header.order + t) for name, t, _ in kinds])
            if place + element.count * kind.itemsize > len(data):
                raise _cut_off(content, element)
            rows = np.frombuffer(data, kind, element.count, place)
            tables[element.name] = {
                name: rows[name].astype(rows[name].dtype.newbyteorder("=")) for name, _, _ in kinds
            }
            place += element.count * kind.itemsize
        else:
            tables[element.name], place = _binary_lists(data, place, header.order, element, content)
    return tables


def _binary_lists(
    data: bytes, place: int, order: str, element: Element, content: MeshContent
) -> tuple[dict[str, Any], int]:
    """An element with lists: at once where all rows are as long as the first, else row by row."""
    even = _even(data, place, order, element)
    if even is not None:
        return even, place + _row_size(data, place, order, element) * element.count
    found: dict[str, list[NDArray[Any]]] = {name: [] for name, _, _ in element.properties}
    for _ in range(element.count):
        for name, kind, length in element.properties:
            size = 1
            if length is not None:
                head = np.dtype(order + length)
                if place + head.itemsize > len(data):
                    raise _cut_off(content, element)
                size = int(np.frombuffer(data, head, 1, place)[0])
                place += head.itemsize
            step = size * np.dtype(kind).itemsize
            if size < 0 or place + step > len(data):
                raise _cut_off(content, element)
            found[name].append(np.frombuffer(data, order + kind, size, place))
            place += step
    table: dict[str, Any] = {}
    for name, kind, length in element.properties:
        flat = np.concatenate(found[name] or [np.zeros(0)]).astype(kind)
        counts = np.array([len(row) for row in found[name]], np.int64)
        table[name] = flat if length is None else (counts, flat)
    return table, place


def _layout(data: bytes, place: int, order: str, element: Element) -> list[Any] | None:
    """The first row as a numpy layout, lists as a length and an array; None if it is cut off."""
    layout: list[Any] = []
    for name, kind, length in element.properties:
        if length is None:
            layout.append((name, order + kind))
            place += np.dtype(kind).itemsize
            continue
        head = np.dtype(order + length)
        if place + head.itemsize > len(data):
            return None
        size = int(np.frombuffer(data, head, 1, place)[0])
        if not 0 <= size * np.dtype(kind).itemsize <= len(data):
            return None
        layout += [(f"{name} length", order + length), (name, order + kind, (size,))]
        place += head.itemsize + size * np.dtype(kind).itemsize
    return layout


def _row_size(data: bytes, place: int, order: str, element: Element) -> int:
    layout = _layout(data, place, order, element)
    return 0 if layout is None else np.dtype(layout).itemsize


def _even(data: bytes, place: int, order: str, element: Element) -> dict[str, Any] | None:
    layout = _layout(data, place, order, element) if element.count else None
    if layout is None:
        return None
    kind = np.dtype(layout)
    if place + kind.itemsize * element.count > len(data):
        return None
    rows = np.frombuffer(data, kind, element.count, place)
    table: dict[str, Any] = {}
    for name, one, length in element.properties:
        if length is None:
            table[name] = rows[name].astype(one)
            continue
        lengths = rows[f"{name} length"]
        if (lengths != lengths[0]).any():
            return None
        table[name] = (lengths.astype(np.int64), rows[name].reshape(-1).astype(one))
    return table


def _from_tristrips(lists: Lists) -> Lists:
    """Triangle strips, separated by −1, as triangles."""
    found: list[int] = []
    strip: list[int] = []
    for index in [*lists[1].tolist(), -1]:
        if index < 0:
            for k in range(len(strip) - 2):
                a, b, c = strip[k : k + 3]
                found += [a, b, c] if k % 2 == 0 else [b, a, c]
            strip = []
        else:
            strip.append(index)
    return np.full(len(found) // 3, 3, np.int64), np.array(found, np.int64)


def _cut_off(content: MeshContent, element: Element) -> InputError:
    return InputError(
        f"{content.path} is cut off or damaged: its header promises {element.count} of "
        f"'{element.name}', fewer are there."
    )
