"""Collada (.dae): triangles and polygons of the scene with their materials, by pycollada.

Never plays animations and never bends skins: a skinned mesh stands as it was modelled.
"""

from __future__ import annotations

import io
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .beside import find_beside, read_bytes
from .content import FileMaterial, MeshContent, MeshPart
from .pictures import Picture, as_bytes, decode_picture
from .polygons import triangulated

UP_AXES = {"X_UP": "x", "Y_UP": "y", "Z_UP": "z"}
NO_SURFACE = ("Light ", "Camera ")  # what pycollada's messages of references begin with


def read_collada(content: MeshContent) -> None:
    """Add the parts of a Collada file to `content`, in the file's own axes and numbers."""
    try:
        import collada
    except ImportError as error:
        raise InputError(
            f"{content.path}: reading Collada lacks a Python package: pip install pycollada."
        ) from error
    data = read_bytes(content.path)
    if b"<!ENTITY" in data:
        raise InputError(f"{content.path}: XML entities are not read; remove its DOCTYPE.")
    common = collada.common
    # What pycollada cannot follow is a light, a camera or an animation as often as a surface.
    document = collada.Collada(
        io.BytesIO(data), ignore=[common.DaeUnsupportedError, common.DaeBrokenRefError]
    )
    if document.scene is None:
        raise InputError(f"{content.path}: holds no scene.")
    unit = document.assetInfo.unitmeter
    content.unit = float(unit) if unit else None  # the format's metre is what nobody meant
    axis = UP_AXES.get(str(document.assetInfo.upaxis), "y")
    content.notes.append(f"{axis} points up by the file; its axes are kept as they are")
    looks = _Looks(content)
    for bound in document.scene.objects("geometry"):
        _add(content, bound, looks)
    for controller in document.scene.objects("controller"):
        _add(content, getattr(controller, "geometry", controller), looks)
    for problem in document.errors:
        text = str(getattr(problem, "msg", problem))[:120]
        lost = isinstance(problem, common.DaeBrokenRefError) and not text.startswith(NO_SURFACE)
        what = f"a part of it is left out, as pycollada says: {text}"
        if not lost:
            content.notes.append(f"pycollada: {text}")
        elif what not in content.warnings:
            content.warnings.append(what)


def _add(content: MeshContent, bound: Any, looks: _Looks) -> None:
    """The primitives of one geometry, its matrix applied."""
    for primitive in bound.primitives():
        if not len(primitive.index):
            continue
        polygons = hasattr(primitive, "triangleset")
        triangles = _triangulated(primitive, content.path) if polygons else primitive
        if not hasattr(triangles, "vertex_index") or "Line" in type(triangles).__name__:
            continue
        index = np.asarray(triangles.vertex_index, np.int64)
        if index.ndim != 2 or index.shape[1] != 3 or not len(index):
            continue
        points = np.asarray(triangles.vertex, np.float64)[index.reshape(-1)]
        part = MeshPart(points, np.arange(len(points)).reshape(-1, 3))
        content.parts.append(looks.applied(part, triangles))


def _triangulated(polygons: Any, path: Path) -> Any:
    """A polylist as a triangle set of pycollada's, whose own way is wrong where one is concave."""
    from collada.triangleset import TriangleSet

    original = polygons.original
    corners = np.asarray(polygons.vertex_index, np.int64)
    counts = np.asarray(original.vcounts, np.int64)
    triangles, _ = triangulated(corners, counts, np.asarray(polygons.vertex, np.float64), path)
    index = original.index[triangles].reshape(-1)
    found = TriangleSet(original.sources, original.material, index, original.xmlnode)
    return found.bind(polygons.matrix, polygons.materialnodebysymbol)


class _Looks:
    """Materials and pictures of one file, each decoded once."""

    def __init__(self, content: MeshContent) -> None:
        self.content = content
        self._pictures: dict[str, Picture | None] = {}
        self._described: set[str] = set()

    def applied(self, part: MeshPart, triangles: Any) -> MeshPart:
        """The part with its picture, vertex colours or plain colour."""
        colors = self._vertex_colors(triangles)
        material = triangles.material
        effect = getattr(material, "effect", None)
        if effect is None:
            part.colors = colors
            return part
        name = str(material.name or material.id)
        self.content.name(f"material {name}")
        picture = next(self._pictures_of(effect, name), None)
        shown = next((one for one in (effect.diffuse, effect.emission) if _is_map(one)), None)
        color = _bytes(effect.diffuse) if picture is None else None
        self._describe(name, picture, color, shown)
        uv = self._coordinates(triangles, shown)
        if picture is not None and uv is None:
            self.content.lost(
                f"the material {name!r} shows a picture, but its faces have no TEXCOORD",
                "export the mesh with UV coordinates",
            )
        if picture is not None and uv is not None:
            part.uv, part.texture = uv, picture.pixels
        elif colors is not None:
            part.colors = colors
        else:
            part.color = color
        return part

    def _pictures_of(self, effect: Any, name: str) -> Iterator[Picture]:
        for shown in (effect.diffuse, effect.emission):
            if _is_map(shown):
                picture = self._picture(str(shown.sampler.surface.image.path), name)
                if picture is not None:
                    yield picture

    def _picture(self, path: str, name: str) -> Picture | None:
        if path in self._pictures:
            return self._pictures[path]
        self.content.name(f"picture {path}")
        found = find_beside(Path(self.content.path), path)
        self._pictures[path] = None
        if found is None:
            self.content.lost(
                f"the material {name!r} shows the picture {path!r}, which is not there",
                "put it beside the mesh or correct the name",
            )
            return None
        try:
            self._pictures[path] = decode_picture(read_bytes(found), str(found))
        except InputError as error:
            self.content.lost(str(error).rstrip("."), "save it as PNG")
        return self._pictures[path]

    def _coordinates(self, triangles: Any, shown: Any) -> NDArray[np.float32] | None:
        sets = triangles.texcoordset
        if not len(sets):
            return None
        number = 0
        wanted = getattr(shown, "texcoord", None)
        for _, semantic, reference, place in getattr(triangles, "inputs", None) or []:
            if reference == wanted and semantic == "TEXCOORD":
                number = int(place or 0)
        number = min(number, len(sets) - 1)
        index = np.asarray(triangles.texcoord_indexset[number], np.int64).reshape(-1)
        return np.asarray(sets[number][index][:, :2], np.float32)

    def _vertex_colors(self, triangles: Any) -> NDArray[np.uint8] | None:
        sources = getattr(triangles, "sources", None) or getattr(
            getattr(triangles, "original", None), "sources", {}
        )
        stored = (sources or {}).get("COLOR")
        index = getattr(triangles, "index", None)
        if not stored or index is None:
            return None
        self.content.name("vertex colours")
        offset, source = stored[0][0], stored[0][4]
        values = np.asarray(source.data, np.float64)
        chosen = values[np.asarray(index)[:, :, offset].reshape(-1)][:, :3]
        return as_bytes(chosen, 255)

    def _describe(
        self, name: str, picture: Picture | None, color: NDArray[np.uint8] | None, shown: Any
    ) -> None:
        if name in self._described:
            return
        self._described.add(name)
        if picture is not None:
            path = str(shown.sampler.surface.image.path)
            self.content.materials.append(FileMaterial(name, path, picture.size))
        else:
            plain = None if color is None else tuple(color.tolist())
            self.content.materials.append(FileMaterial(name, color=plain))


def _is_map(shown: Any) -> bool:
    return hasattr(shown, "sampler")


def _bytes(color: Any) -> NDArray[np.uint8] | None:
    """A plain colour; Collada's are display colours, as its exporters mean them."""
    if color is None or _is_map(color):
        return None
    values = np.asarray(color, np.float64).reshape(-1)[:3]
    return as_bytes(values, 255)
