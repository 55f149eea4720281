"""The looks of a PLY file: pictures, materials, and colours per vertex, per face or per corner.

Never parses the file itself.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .beside import find_beside, read_bytes
from .content import FileMaterial, MeshContent, MeshPart
from .join import PLAIN
from .pictures import Picture, as_bytes, decode_picture

UV_NAMES = (("texture_u", "texture_v"), ("s", "t"), ("u", "v"), ("texture_s", "texture_t"))
COLOR_NAMES = (("red", "green", "blue"), ("diffuse_red", "diffuse_green", "diffuse_blue"),
               ("r", "g", "b"))  # fmt: skip

Table = dict[str, Any]  # an element's columns by property name
Colors = NDArray[np.uint8] | None


@dataclass
class PlyShape:
    """The faces of a file, polygons first: `triangles` are positions in `corners`."""

    points: NDArray[np.float64]  # (V, 3)
    corners: NDArray[np.int64]  # (C,), a vertex for each corner of each polygon
    counts: NDArray[np.int64]  # (P,), corners of each polygon
    triangles: NDArray[np.int64]  # (T, 3)
    polygon: NDArray[np.int64]  # (T,), of each triangle


def add_parts(
    content: MeshContent, shape: PlyShape, tables: dict[str, Table], names: list[str]
) -> None:
    """Parts by picture (`names` are those of the header), or one part with its colours."""
    vertex, face = tables.get("vertex", {}), tables.get("face", {})
    textures = _textures(content, names)
    colors, face_colors = _colors(vertex), _colors(face)
    if colors is not None or face_colors is not None:
        content.name("vertex colours" if colors is not None else "face colours")
    elif not textures and "material" in tables:
        colors, face_colors = _material_colors(content, shape, tables)
    pair = next((pair for pair in UV_NAMES if set(pair) <= set(vertex)), None)
    uv: Any = None if pair is None else np.stack([vertex[name] for name in pair], -1)
    own = _corner_uv(shape, face) if textures else None
    number = np.zeros(len(shape.triangles), np.int64)
    if own is not None or (textures and uv is not None):
        number = _picture_numbers(content, face, shape.polygon, len(textures))
    if own is not None or (textures and uv is not None and (number != number[:1]).any()):
        at = own if own is not None else uv[shape.corners]
        looks = (colors, None if face_colors is None else face_colors[shape.polygon])
        _add_by_picture(content, shape, at[shape.triangles], number, textures, looks)
        return
    faces = shape.corners[shape.triangles]
    part = MeshPart(shape.points, faces)
    if uv is not None and textures:
        _dress(part, textures[number.max(initial=0)], uv, colors)
    elif colors is not None:
        part.colors = colors
    elif face_colors is not None:
        corner = np.arange(3 * len(faces)).reshape(-1, 3)
        part = MeshPart(shape.points[faces].reshape(-1, 3), corner)
        part.colors = np.repeat(face_colors[shape.polygon], 3, axis=0)
    elif textures:
        content.lost(
            f"names the picture {names[0]!r}, but has no texture coordinates",
            "export it with texture_u and texture_v",
        )
    content.parts.append(part)


def _corner_uv(shape: PlyShape, face: Table) -> NDArray[np.float64] | None:
    """The `texcoord` of each corner (C, 2), NaN for faces that have none; None if all have none."""
    stored = face.get("texcoord")
    if not isinstance(stored, tuple):
        return None
    lengths, values = stored
    if len(lengths) != len(shape.counts):
        return None
    whole = (lengths == 2 * shape.counts) & (shape.counts > 0)
    if not whole.any():
        return None
    found = np.full((len(shape.corners), 2), np.nan)
    found[np.repeat(whole, shape.counts)] = values[np.repeat(whole, lengths)].reshape(-1, 2)
    return found


def _add_by_picture(
    content: MeshContent, shape: PlyShape, uv: NDArray[Any], number: NDArray[np.int64],
    textures: list[Picture | None], looks: tuple[Colors, Colors],
) -> None:  # fmt: skip
    """A part for each picture that triangles show by `number`; `uv` (T, 3, 2) is NaN for none.

    `looks` are colours of vertices and of triangles.
    """
    colors, triangle_colors = looks
    faces = shape.corners[shape.triangles]
    absent = np.isnan(uv).all((1, 2)) & (number >= 0)
    for index in np.unique(number).tolist():
        picture = None if index < 0 else textures[index]
        for without in (False, True):
            chosen = (number == index) & (absent == without)
            if not chosen.any():
                continue
            corner = faces[chosen].reshape(-1)
            part = MeshPart(shape.points[corner], np.arange(len(corner)).reshape(-1, 3))
            shown = None if colors is None else colors[corner]
            if shown is None and (index < 0 or without) and triangle_colors is not None:
                shown = np.repeat(triangle_colors[chosen], 3, axis=0)
            _dress(part, None if without else picture, uv[chosen].reshape(-1, 2), shown)
            if without and picture is not None and shown is None:
                # The picture's own colour is nearer than grey.
                part.color = picture.pixels.reshape(-1, 3).mean(0).round().astype(np.uint8)
            content.parts.append(part)
    missing = len(np.unique(shape.polygon[absent]))
    if missing:
        plain = colors is None and triangle_colors is None
        what = "the picture's mean colour" if plain else "their own colours"
        content.warnings.append(
            f"{missing} of {len(shape.counts)} faces have no texture coordinates and take {what}"
        )


def _material_colors(
    content: MeshContent, shape: PlyShape, tables: dict[str, Table]
) -> tuple[Colors, Colors]:
    """Colours of vertices or of faces by their `material_index`: the materials' diffuse ones."""
    content.name("materials")
    table = tables["material"]
    colors = _colors(table)
    if colors is None or not len(colors):
        content.lost(
            "its materials have no diffuse_red, diffuse_green and diffuse_blue",
            "export it with colours per vertex",
        )
        return None, None
    for element in ("face", "vertex"):
        stored = tables.get(element, {}).get("material_index")
        if isinstance(stored, np.ndarray):
            shown = _by_index(content, stored.astype(np.int64), colors)
            return (None, shown) if element == "face" else (shown, None)
    if len(colors) == 1:
        return np.repeat(colors, len(shape.points), axis=0), None
    content.lost(
        f"no material_index says which of its {len(colors)} materials a face has",
        "export it with colours per vertex",
    )
    return None, None


def _by_index(
    content: MeshContent, index: NDArray[np.int64], colors: NDArray[np.uint8]
) -> NDArray[np.uint8]:
    there = (index >= 0) & (index < len(colors))
    if not there.all():
        content.warnings.append(
            f"{int((~there).sum())} of {len(index)} values of material_index name none of the "
            f"{len(colors)} materials and are shown grey"
        )
    return np.where(there[:, None], colors[index.clip(0, len(colors) - 1)], PLAIN).astype(np.uint8)


def _picture_numbers(
    content: MeshContent, face: Table, polygon: NDArray[np.int64], count: int
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


def _colors(table: Table) -> Colors:
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
