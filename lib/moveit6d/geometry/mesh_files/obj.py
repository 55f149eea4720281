"""Wavefront OBJ: geometry, texture coordinates, vertex colours and materials.

Never reads free-form curves and surfaces. Format: Wavefront, "Object Files", appendix B1.
"""

from __future__ import annotations

import re
import warnings
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .beside import decoded, find_beside, read_bytes
from .content import MeshContent
from .mtl import MtlMaterial, read_mtl
from .obj_materials import add_parts
from .pictures import as_bytes
from .polygons import triangulated

Index = NDArray[np.int64]


@dataclass
class ObjLines:
    """The lines of an OBJ file sorted by what they say; faces know where in the file they stood."""

    points: list[str] = field(default_factory=list)
    texture: list[str] = field(default_factory=list)
    corners: list[str] = field(default_factory=list)  # v, v/vt, v//vn or v/vt/vn of every corner
    counts: list[int] = field(default_factory=list)  # corners of every face
    before: list[tuple[int, int]] = field(default_factory=list)  # v and vt seen before every face
    material: list[int] = field(default_factory=list)  # of every face; −1 before any usemtl
    names: list[str] = field(default_factory=list)  # of materials, in order of appearance
    libraries: list[str] = field(default_factory=list)
    lines: list[int] = field(default_factory=list)  # line number of every face


@dataclass
class ObjGeometry:
    """An OBJ file's numbers. Corner c of face f has vertex `vertex[f, c]` and vt `uv_at[f, c]`."""

    points: NDArray[np.float64]  # (V, 3)
    colors: NDArray[np.uint8] | None  # (V, 3)
    uv: NDArray[np.float64]  # (T, 2)
    vertex: Index  # (F, 3)
    uv_at: Index  # (F, 3), −1 where there is none
    material: Index  # (F,), −1 for none
    names: list[str]


def read_obj(content: MeshContent) -> None:
    """Add the parts of an OBJ file to `content`."""
    path = content.path
    lines = _sorted_lines(decoded(read_bytes(path)))
    if not lines.counts:
        raise InputError(f"{path}: holds no faces; a mesh of triangles is needed.")
    rows = _table(lines.points, path, "v")
    points, colors = rows[:, :3], _colors(rows, content)
    uv = _table(lines.texture, path, "vt")[:, :2]
    corners, corner_uv = _corners(lines, len(points), len(uv), path)
    counts = np.array(lines.counts, np.int64)
    triangles, face = triangulated(corners, counts, points, path)
    geometry = ObjGeometry(
        points, colors, uv, corners[triangles], corner_uv[triangles],
        np.array(lines.material, np.int64)[face], lines.names,
    )  # fmt: skip
    add_parts(content, geometry, _libraries(content, lines))


def _sorted_lines(text: str) -> ObjLines:
    found, current = ObjLines(), -1
    text = re.sub(r"\\[ \t]*\r?\n", " ", text) if "\\" in text else text
    known: dict[str, int] = {}
    for number, line in enumerate(text.replace("\r\n", "\n").replace("\r", "\n").split("\n"), 1):
        line = line.lstrip()
        key = line[:2]
        if key in ("v ", "v\t"):
            found.points.append(line[2:])
        elif key == "vt":
            found.texture.append(line[2:])
        elif key in ("f ", "f\t"):
            tokens = line[2:].partition("#")[0].split()
            found.corners += tokens
            found.counts.append(len(tokens))
            found.before.append((len(found.points), len(found.texture)))
            found.material.append(current)
            found.lines.append(number)
        elif key == "us" and line.split(None, 1)[0] == "usemtl":
            name = line[6:].strip()
            current = known.setdefault(name, len(known))
        elif key == "mt" and line.split(None, 1)[0] == "mtllib":
            found.libraries.append(line[6:].strip())
    found.names = list(known)
    return found


def _table(rows: list[str], path: Path, keyword: str) -> NDArray[np.float64]:
    """Rows of numbers as one array; short rows are filled with NaN."""
    if not rows:
        return np.zeros((0, 3))
    width = len(rows[0].split())
    flat = _parsed(" ".join(rows), np.float64)
    if flat is not None and width and flat.size == width * len(rows) and _even(rows, width):
        return _at_least(flat.reshape(-1, width))
    numbers = [_numbers(row, path, keyword) for row in rows]
    table = np.full((len(rows), max(map(len, numbers))), np.nan)
    for row, values in zip(table, numbers, strict=True):
        row[: len(values)] = values
    return _at_least(table)


def _at_least(table: NDArray[np.float64]) -> NDArray[np.float64]:
    if table.shape[1] >= 3:
        return table
    return np.pad(table, ((0, 0), (0, 3 - table.shape[1])))  # vt may have one or two numbers


def _even(rows: list[str], width: int) -> bool:
    return all(len(row.split()) == width for row in rows)


def _parsed(text: str, kind: type) -> NDArray[np.float64] | None:
    """All numbers of a text by numpy's fast parser, None where it stumbles."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            return np.fromstring(text, kind, sep=" ")
        except (ValueError, DeprecationWarning):
            return None


def _numbers(row: str, path: Path, keyword: str) -> list[float]:
    try:
        values = [float(part) for part in row.partition("#")[0].split()]
    except ValueError:
        values = []
    if len(values) < (3 if keyword == "v" else 1):
        raise InputError(f"{path}: '{keyword} {row.strip()[:60]}' is not a row of numbers.")
    return values


def _colors(rows: NDArray[np.float64], content: MeshContent) -> NDArray[np.uint8] | None:
    """Colours behind the coordinates: x y z r g b, or with a weight before or an alpha behind.

    They are 0 to 1, or 0 to 255.
    """
    if rows.shape[1] < 6:
        return None
    weighted = rows.shape[1] == 7 and _weight_first(rows[:, 3:], content)
    colors = rows[:, 4:7] if weighted else rows[:, 3:6]
    if not np.isfinite(colors).all():
        colors = np.nan_to_num(colors, nan=1.0 if np.nanmax(colors) <= 1 else 255.0)
    scale = 255.0 if colors.max() <= 1 else 1.0
    return as_bytes(colors, scale)


def _weight_first(values: NDArray[np.float64], content: MeshContent) -> bool:
    """Whether four numbers behind the coordinates (N, 4) are w r g b, and not r g b alpha."""
    whole = values[np.isfinite(values).all(1)]
    if (whole[:, 1:] == whole[:, :3]).all():  # the same either way
        return True
    weight = bool((whole[:, 0] == 1).all())
    alpha = any(bool((whole[:, 3] == full).all()) for full in (1, 255))
    if weight != alpha:
        return weight
    fractions = bool(((whole >= 0) & (whole <= 1)).all())
    levels = bool(((whole >= 0) & (whole <= 255) & (whole == np.rint(whole))).all())
    # Where colours reach 255, 1 at every vertex is a weight rather than a red.
    first = not fractions and (weight or not levels)
    order = "x y z w r g b" if first else "x y z r g b alpha"
    content.warnings.append(
        f"its v lines have seven numbers, which may mean two things, and are read as {order}"
    )
    return first


def _corners(lines: ObjLines, points: int, coordinates: int, path: Path) -> tuple[Index, Index]:
    """Vertex and texture numbers from 0 of every corner; −1 where a corner has no texture."""
    table = _indices(lines, path)  # (N, 2), 0 where nothing is given
    counts = np.array(lines.counts)
    before = np.repeat(np.array(lines.before), counts, axis=0)
    table = np.where(table < 0, before + table + 1, table)
    vertex, texture = table[:, 0] - 1, table[:, 1] - 1
    wrong = (vertex < 0) | (vertex >= points) | (texture < -1) | (texture >= coordinates)
    if wrong.any():
        face = int(np.repeat(np.arange(len(counts)), counts)[np.flatnonzero(wrong)[0]])
        raise InputError(
            f"{path}, line {lines.lines[face]}: a face names a vertex that is not there "
            f"({points} vertices and {coordinates} texture coordinates are; they count from 1)."
        )
    return vertex, texture


def _indices(lines: ObjLines, path: Path) -> Index:
    text = " ".join(lines.corners)
    slashes = {token.count("/") for token in lines.corners}
    if slashes <= {0} or slashes in ({1}, {2}):
        width = slashes.copy().pop() + 1
        flat = _parsed(text.replace("//", "/0/").replace("/", " "), np.int64)
        if flat is not None and flat.size == width * len(lines.corners):
            table = flat.reshape(-1, width).astype(np.int64)
            return table[:, :2] if width > 1 else np.pad(table, ((0, 0), (0, 1)))
    return np.array([_index(token, path) for token in lines.corners], np.int64)


def _index(token: str, path: Path) -> tuple[int, int]:
    parts = [*token.split("/"), ""]
    try:
        vertex, texture = int(parts[0]), int(parts[1] or 0)
        if max(abs(vertex), abs(texture)) < 2**62:
            return vertex, texture
    except ValueError:
        pass
    raise InputError(f"{path}: a face's corner is {token[:40]!r}, not v, v/vt, v//vn or v/vt/vn.")


def _libraries(content: MeshContent, lines: ObjLines) -> dict[str, MtlMaterial]:
    """The materials of all libraries that the file names and that are there."""
    paths: list[Path] = []
    missing: list[str] = []
    for text in lines.libraries:
        whole = find_beside(content.path, text)
        names = [text] if whole is not None else text.split()
        for name in names:  # several libraries may stand on a line
            found = find_beside(content.path, name)
            if found is None:
                missing.append(name)
            else:
                paths.append(found)
    own = find_beside(content.path, f"{content.path.stem}.mtl")
    if not paths and lines.names and own is not None:
        content.warnings.append(f"materials are taken from {own.name}, which lies beside the mesh")
        paths.append(own)
        missing = []
    for name in missing:
        content.name(f"material library {name}")
    materials: dict[str, MtlMaterial] = {}
    for path in paths:
        for name, material in read_mtl(path).items():
            materials.setdefault(name, material)
    content.notes += [f"the material library {name} is not there" for name in missing]
    return materials
