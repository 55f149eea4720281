"""Meshes as the files that data sets keep them in: PLY (BOP, Laval) and OBJ (YCB-Video, RBOT).

Never reads; `Mesh.load` does.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from ..geometry.mesh import METRES, Mesh
from ..geometry.mesh_files.join import PLAIN
from ..io import replacing

# BOP's own loader knows only these names of types, not float32 and int32.
PLY_NAMES = {"f4": "float", "f8": "double", "u1": "uchar"}
ROUNDING = 1e-6  # of the diameter: coarser numbers than this would bend the surface


def write_ply(path: str | Path, mesh: Mesh, unit: Literal["m", "mm"] = "m") -> None:
    """A binary PLY that `Mesh.load(path, unit)` reads back, in the mesh's own frame.

    A texture goes beside it as PNG, named in a comment `TextureFile`, with `texture_u/v` a vertex
    (thodan/bop_toolkit docs/bop_datasets_format.md; lvsn/6DOF_tracking_evaluation plyparser.py).
    A plain grey mesh gets no colours; one flat colour is written, and read with `allow_flat`. Far
    from the frame's origin vertices are of double precision.
    """
    path = Path(path)
    columns: list[tuple[str, str, NDArray[np.generic]]] = []
    points = _points(mesh) / METRES[unit]
    kind = "f4" if _single_is_enough(points, mesh.diameter / METRES[unit]) else "f8"
    columns += [(name, kind, points[:, k]) for k, name in enumerate("xyz")]
    columns += [(f"n{name}", "f4", mesh.normals[:, k]) for k, name in enumerate("xyz")]
    comment = ""
    if mesh.texture is not None and mesh.uv is not None:
        columns += [(f"texture_{name}", "f4", mesh.uv[:, k]) for k, name in enumerate("uv")]
        comment = f"comment TextureFile {_texture_path(path).name}\n"
    elif mesh.vertex_colors is not None and not is_plain(mesh):
        names = ("red", "green", "blue")
        columns += [(name, "u1", mesh.vertex_colors[:, k]) for k, name in enumerate(names)]
    vertices = np.empty(len(points), [(name, f"<{kind}") for name, kind, _ in columns])
    for name, _, values in columns:
        vertices[name] = values
    faces = np.empty(len(mesh.faces), [("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    properties = "".join(f"property {PLY_NAMES[kind]} {name}\n" for name, kind, _ in columns)
    head = (
        f"ply\nformat binary_little_endian 1.0\n{comment}element vertex {len(vertices)}\n"
        f"{properties}element face {len(faces)}\nproperty list uchar int vertex_indices\n"
        "end_header\n"
    )
    content = head.encode("utf-8") + vertices.tobytes() + faces.tobytes()
    with replacing(path) as temporary:
        temporary.write_bytes(content)
        if mesh.texture is not None and mesh.uv is not None:
            _write_texture(path, mesh.texture)


def write_obj(path: str | Path, mesh: Mesh, unit: Literal["m", "mm"] = "m") -> None:
    """An OBJ that `Mesh.load(path, unit)` reads back, in the mesh's own frame.

    A texture goes beside it with its MTL file; colours stand behind the vertices' coordinates. A
    plain grey mesh gets no colours; one flat colour is written, and read with `allow_flat`.
    """
    path = Path(path)
    points = _points(mesh) / METRES[unit]
    digits = 9 if _single_is_enough(points, mesh.diameter / METRES[unit]) else 17
    lines = []
    if mesh.texture is not None and mesh.uv is not None:
        material = path.with_suffix(".mtl")
        picture = _write_texture(path, mesh.texture)
        with replacing(material) as temporary:
            text = f"newmtl surface\nKa 1 1 1\nKd 1 1 1\nmap_Kd {picture}\n"
            temporary.write_text(text, encoding="utf-8")
        lines += [f"mtllib {material.name}", "usemtl surface"]
        lines += _rows(points, digits)
        lines += [f"vt {u:.7g} {v:.7g}" for u, v in mesh.uv.tolist()]
        lines += [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in (mesh.faces + 1).tolist()]
    else:
        lines += _rows(points, digits)
        if mesh.vertex_colors is not None and not is_plain(mesh):
            colors = (mesh.vertex_colors / 255).tolist()
            shades = [" ".join(f"{value:.9g}" for value in color) for color in colors]
            lines = [f"{line} {shade}" for line, shade in zip(lines, shades, strict=True)]
        lines += [f"f {a} {b} {c}" for a, b, c in (mesh.faces + 1).tolist()]
    with replacing(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")


def is_plain(mesh: Mesh) -> bool:
    """Whether a mesh has no colour of its own, just the grey that `Mesh` gives to such."""
    return mesh.vertex_colors is not None and bool((mesh.vertex_colors == PLAIN).all())


def _rows(points: NDArray[np.float64], digits: int) -> list[str]:
    return [f"v {x:.{digits}g} {y:.{digits}g} {z:.{digits}g}" for x, y, z in points.tolist()]


def _single_is_enough(points: NDArray[np.float64], diameter: float) -> bool:
    """Whether single precision keeps the shape; far from the origin it does not."""
    return bool(np.abs(points.astype(np.float32) - points).max() <= ROUNDING * diameter)


def _points(mesh: Mesh) -> NDArray[np.float64]:
    """The vertices (V, 3) in the file's frame, metres."""
    return mesh.vertices.astype(np.float64) + mesh.center


def _write_texture(path: Path, texture: NDArray[np.uint8]) -> str:
    """The texture as PNG beside `path`; its name, which names no folder."""
    from PIL import Image

    picture = _texture_path(path)
    with replacing(picture) as temporary:
        Image.fromarray(texture).save(temporary)
    return picture.name


def _texture_path(path: Path) -> Path:
    return path.with_name(f"{path.stem}_texture.png")
