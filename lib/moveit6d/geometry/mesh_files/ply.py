"""PLY: ASCII and binary, with colours or texture coordinates per vertex, per face or per corner.

Never reads edges, tristrips are unrolled. Format: Greg Turk, "The PLY polygon file format", and
what MeshLab, Meshroom, Open3D and BOP's tools write.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .beside import find_beside, read_bytes
from .content import FileMaterial, MeshContent, MeshPart
from .pictures import Picture, as_bytes, decode_picture
from .polygons import triangulated

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2",
    "ushort": "u2", "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4",
    "float": "f4", "float32": "f4", "double": "f8", "float64": "f8",
}  # fmt: skip
ORDERS = {"ascii": "", "binary_little_endian": "<", "binary_big_endian": ">"}
UV_NAMES = (("texture_u", "texture_v"), ("s", "t"), ("u", "v"), ("texture_s", "texture_t"))
COLOR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"),
               ("r", "g", "b"))  # fmt: skip
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
    _add(content, header, points, vertex, face, corners, triangles, polygon)


def _add(
    content: MeshContent, header: Header, points: NDArray[np.float64], vertex: dict[str, Any],
    face: dict[str, Any], corners: NDArray[np.int64], triangles: NDArray[np.int64],
    polygon: NDArray[np.int64],
) -> None:  # fmt: skip
    """Parts by texture, or one part with its colours."""
    faces = corners[triangles]
    names = next((pair for pair in UV_NAMES if set(pair) <= set(vertex)), None)
    textures = _textures(content, header.textures)
    colors = _colors(vertex)
    face_colors = _colors(face)
    if colors is not None or face_colors is not None:
        content.name("vertex colours" if colors is not None else "face colours")
    own = bool(textures) and "texcoord" in face
    own = own and len(face["texcoord"][1]) == 2 * len(corners)
    uv: Any = None if names is None else np.stack([vertex[name] for name in names], -1)
    number = np.zeros(len(faces), np.int64)
    if textures and (own or uv is not None):
        number = _picture_numbers(content, face, polygon, len(textures))
    if textures and (own or (uv is not None and (number != number[:1]).any())):
        at = triangles if own else faces
        uv = face["texcoord"][1].reshape(-1, 2) if own else uv
        for index in np.unique(number).tolist():
            chosen = number == index
            corner = faces[chosen].reshape(-1)
            part = MeshPart(points[corner], np.arange(len(corner)).reshape(-1, 3))
            shown = None if colors is None else colors[corner]
            if shown is None and index < 0 and face_colors is not None:
                shown = np.repeat(face_colors[polygon[chosen]], 3, axis=0)
            picture = None if index < 0 else textures[index]
            _dress(part, picture, uv[at[chosen].reshape(-1)], shown)
            content.parts.append(part)
        return
    part = MeshPart(points, faces)
    if uv is not None and textures:
        _dress(part, textures[number.max(initial=0)], uv, colors)
    elif colors is not None:
        part.colors = colors
    elif face_colors is not None:
        corner = np.arange(3 * len(faces)).reshape(-1, 3)
        part = MeshPart(points[faces].reshape(-1, 3), corner)
        part.colors = np.repeat(face_colors[polygon], 3, axis=0)
    elif textures:
        content.lost(
            f"names the picture {header.textures[0]!r}, but has no texture coordinates",
            "export it with texture_u and texture_v",
        )
    content.parts.append(part)


def _picture_numbers(
    content: MeshContent, face: dict[str, Any], polygon: NDArray[np.int64], count: int
) -> NDArray[np.int64]:
    """The picture (T,) of each triangle by the `texnumber` of its face; −1 for none."""
    stored = face.get("texnumber")
    if not isinstance(stored, np.ndarray):
        return np.zeros(len(polygon), np.int64)
    number = stored.astype(np.int64)[polygon]
    if len(number) and (number < 0).all():
        content.notes.append("no face has a picture by its texnumber; all show the first one")
        return np.zeros(len(polygon), np.int64)
    beyond = int((number >= count).sum())
    if beyond:
        content.warnings.append(
            f"{beyond} of {len(number)} faces have a texnumber beyond the {count} pictures named "
            "and show the last one"
        )
    return number.clip(-1, count - 1)


def _dress(
    part: MeshPart, picture: Picture | None, uv: NDArray[Any], colors: NDArray[np.uint8] | None
) -> None:
    """Give a part its texture or, where that is not there, its colours."""
    if picture is None:
        part.colors = colors
        return
    part.texture, part.uv = picture.pixels, uv.astype(np.float32)


def _textures(content: MeshContent, names: list[str]) -> list[Picture | None]:
    """The pictures of all `comment TextureFile` lines; None for those that are not there."""
    found: list[Picture | None] = []
    for name in names:
        content.name(f"picture {name}")
        path = find_beside(content.path, name)
        picture = None
        if path is None:
            content.lost(
                f"the picture {name!r} (comment TextureFile) is not there",
                "put it beside the mesh or correct the name",
            )
        else:
            try:
                picture = decode_picture(read_bytes(path), str(path))
            except InputError as error:
                content.lost(str(error).rstrip("."), "save it as PNG")
        if picture is not None:
            content.materials.append(FileMaterial(f"picture {name}", name, picture.size))
        found.append(picture)
    return found


def _colors(table: dict[str, Any]) -> NDArray[np.uint8] | None:
    """Colours (N, 3) of an element: bytes, 16 bits, or fractions as floats."""
    for names in COLOR_NAMES:
        if set(names) <= set(table):
            values = np.stack([table[name] for name in names], -1)
            if values.dtype == np.uint8:
                return np.asarray(values)
            wide = values.astype(np.float64)
            largest = float(np.nan_to_num(wide).max(initial=0))
            scale = 255.0 if values.dtype.kind == "f" and largest <= 1 else 1.0
            if values.dtype.kind in "iu" and largest > 255:
                scale = 1 / 257
            return as_bytes(wide, scale)
    return None


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
