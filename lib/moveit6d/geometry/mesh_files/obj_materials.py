"""The parts of an OBJ file by material: which picture, colours or plain colour each one shows.

Never parses the OBJ file itself.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .beside import find_beside, read_bytes
from .content import FileMaterial, MeshContent, MeshPart
from .cutout import cut_out
from .mtl import Map, MtlMaterial
from .pictures import Picture, as_bytes, decode_picture

if TYPE_CHECKING:
    from .obj import ObjGeometry

Pictures = dict[str, Picture | None]  # by path, or by name where there is no such file


def add_parts(
    content: MeshContent, geometry: ObjGeometry, materials: dict[str, MtlMaterial]
) -> None:
    """One part for each material that faces use, with its looks."""
    pictures: Pictures = {}
    if geometry.colors is not None:
        content.name("vertex colours")
    for number in np.unique(geometry.material).tolist():
        material = _chosen(content, geometry, number, materials)
        faces = geometry.material == number
        vertex, uv_at = geometry.vertex[faces], geometry.uv_at[faces]
        picture = None
        if material is not None:
            content.name(f"material {material.name or '(without a name)'}")
            picture = _picture(content, material, material.picture, pictures)
        textured = (uv_at >= 0).all(1)
        if picture is not None and not textured.all():
            _without_coordinates(content, material, textured)
        if material is not None:
            content.materials.append(_facts(material, picture))
        if picture is None or material is None or material.picture is None:
            if material is not None and material.unread and geometry.colors is None:
                _unread_color(content, material)
            content.parts.append(_plain(geometry, vertex, material))
            continue
        if textured.any():
            part = _textured(geometry, vertex[textured], uv_at[textured], picture, material.picture)
            mask = _mask(content, material, picture, pictures)
            content.parts.append(part if mask is None else cut_out(part, mask, 128))
        if not textured.all():
            part = _plain(geometry, vertex[~textured], None)
            if part.colors is None:  # the picture's own colour is nearer than grey
                part.color = picture.pixels.reshape(-1, 3).mean(0).round().astype(np.uint8)
            content.parts.append(part)


def _chosen(
    content: MeshContent, geometry: ObjGeometry, number: int, materials: dict[str, MtlMaterial]
) -> MtlMaterial | None:
    """The material of faces: that of their `usemtl`, or the only one where there is no usemtl."""
    if number >= 0:
        return _named(content, geometry, geometry.names[number], materials)
    if not materials or geometry.names:
        if not geometry.names and geometry.colors is None:
            _missing_library(content, "")
        return None
    showing = [one for one in materials.values() if one.picture is not None]
    chosen = showing if len(materials) > 1 else list(materials.values())
    if len(chosen) == 1:
        return chosen[0]
    if geometry.colors is None:
        content.name("materials")
        content.lost(
            f"no usemtl says which of the materials {_listed(materials)} its faces have",
            "add a usemtl line before the faces",
        )
    return None


def _named(
    content: MeshContent, geometry: ObjGeometry, name: str, materials: dict[str, MtlMaterial]
) -> MtlMaterial | None:
    if name in materials:
        return materials[name]
    folded = {key.strip().casefold(): one for key, one in materials.items()}
    if name.strip().casefold() in folded:
        return folded[name.strip().casefold()]
    content.name(f"material {name}")
    if geometry.colors is not None:
        return None  # the colours of the vertices say how it looks
    if not materials:
        _missing_library(content, name)
    else:
        content.lost(
            f"its faces have the material {name!r}, but the material libraries define only "
            f"{_listed(materials)}",
            "correct the usemtl line or the library",
        )
    return None


def _missing_library(content: MeshContent, name: str) -> None:
    missing = [what for what in content.named if what.startswith("material library ")]
    if missing:
        content.lost(f"the {missing[0]} is not there", "put it beside the mesh")
    elif name:
        content.lost(
            f"its faces have the material {name!r}, but no mtllib line names a file with it",
            f"put {content.path.stem}.mtl beside the mesh",
        )


def _picture(
    content: MeshContent, material: MtlMaterial, entry: Map | None, pictures: Pictures
) -> Picture | None:
    """The decoded picture of a material; None, with a word, where it cannot be had."""
    if entry is None:
        return None
    content.name(f"picture {entry.name}")
    what = f"the material {material.name!r} of {material.library.name}"
    path = find_beside(material.library, entry.name)
    path = path or find_beside(content.path, entry.name)
    path = path or find_beside(content.path, entry.name.partition(" #")[0])
    key = entry.name if path is None else str(path.resolve())
    if key in pictures:
        return pictures[key]
    pictures[key] = None
    if path is None:
        content.lost(
            f"{what} shows the picture {entry.name!r}, which is not there",
            "put it beside the mesh or correct the name",
        )
        return None
    try:
        pictures[key] = decode_picture(read_bytes(path), str(path))
    except InputError as error:
        content.lost(
            f"{what} shows the picture {entry.name!r}, but {str(error).rstrip('.')}",
            "save it as PNG",
        )
    return pictures[key]


def _mask(
    content: MeshContent, material: MtlMaterial, shown: Picture, pictures: Pictures
) -> NDArray[np.uint8] | None:
    """The picture of `map_d`: its alpha if it has one, else its grey values.

    None where exporters name the picture that is `shown` there although it has no alpha: its dark
    parts are no holes.
    """
    picture = _picture(content, material, material.mask, pictures)
    if picture is None:
        return None
    if picture.alpha is not None:
        return picture.alpha
    return None if np.array_equal(picture.pixels, shown.pixels) else picture.pixels[..., 0]


def _unread_color(content: MeshContent, material: MtlMaterial) -> None:
    content.lost(
        f"the material {material.name!r} of {material.library.name} has the colour "
        f"{material.unread[:60]!r}, which is not understood",
        "write it as Kd and three numbers from 0 to 1",
    )


def _without_coordinates(
    content: MeshContent, material: MtlMaterial | None, textured: NDArray[np.bool_]
) -> None:
    name = "" if material is None else material.name
    if textured.any():
        missing = int((~textured).sum())
        content.warnings.append(
            f"{missing} of {len(textured)} faces of material {name!r} have no texture coordinates "
            "and take the picture's mean colour"
        )
    else:
        content.lost(
            f"the material {name!r} shows a picture, but its faces have no texture coordinates",
            "export the mesh with UV coordinates",
        )


def _textured(
    geometry: ObjGeometry, vertex: NDArray[np.int64], uv_at: NDArray[np.int64],
    picture: Picture, entry: Map,
) -> MeshPart:  # fmt: skip
    """Corners of the same vertex and the same texture coordinates become one vertex."""
    key = vertex * (len(geometry.uv) + 1) + uv_at
    unique, corners = np.unique(key.reshape(-1), return_inverse=True)
    points, at = np.divmod(unique, len(geometry.uv) + 1)
    uv = geometry.uv[at] * entry.scale + entry.offset
    pixels = picture.pixels
    if (entry.base, entry.gain) != (0.0, 1.0):
        pixels = as_bytes(255 * entry.base + entry.gain * pixels)
    wrap = "clamp" if entry.clamp else "repeat"
    return MeshPart(
        geometry.points[points], corners.reshape(-1, 3), uv.astype(np.float32), pixels,
        wrap=(wrap, wrap),
    )  # fmt: skip


def _plain(
    geometry: ObjGeometry, vertex: NDArray[np.int64], material: MtlMaterial | None
) -> MeshPart:
    used, faces = np.unique(vertex.reshape(-1), return_inverse=True)
    part = MeshPart(geometry.points[used], faces.reshape(-1, 3))
    if geometry.colors is not None:
        part.colors = geometry.colors[used]
    elif material is not None and material.color is not None:
        part.color = as_bytes(material.color, 255)
    return part


def _facts(material: MtlMaterial, picture: Picture | None) -> FileMaterial:
    if picture is not None and material.picture is not None:
        return FileMaterial(material.name, material.picture.name, picture.size)
    if material.color is None:
        return FileMaterial(material.name)
    return FileMaterial(material.name, color=tuple(as_bytes(material.color, 255).tolist()))


def _listed(names: dict[str, MtlMaterial]) -> str:
    some = [repr(name) for name in list(names)[:5]]
    return ", ".join(some) + (f" and {len(names) - 5} more" if len(names) > 5 else "")
