"""OFF and its variants with colours (COFF) and normals (NOFF).

Never reads the binary variant. Format: Geomview manual, "OFF files".
"""

from __future__ import annotations

import re

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from .beside import decoded, read_bytes
from .content import MeshContent, MeshPart
from .join import PLAIN
from .pictures import as_bytes
from .polygons import triangulated

HEAD = re.compile(r"(ST)?(C)?(N)?(4)?(n)?OFF\b", re.ASCII)


def read_off(content: MeshContent) -> None:
    """Add the part of an OFF file to `content`."""
    path = content.path
    text = re.sub(r"#[^\n\r]*", "", decoded(read_bytes(path)))
    head = HEAD.match(text.lstrip())
    if head is None or head[4] or head[5] or "BINARY" in text[:40]:
        raise InputError(f"{path}: cannot be read as a mesh (it is no plain OFF file).")
    lines = [line.split() for line in text.lstrip()[head.end() :].splitlines()]
    lines = [line for line in lines if line]
    try:
        vertices, faces = int(lines[0][0]), int(lines[0][1])
        rows = [[float(value) for value in line] for line in lines[1 : 1 + vertices]]
        polygons = [
            [int(line[0]), *(float(value) for value in line[1:])]
            for line in lines[1 + vertices : 1 + vertices + faces]
        ]
    except (ValueError, IndexError) as error:
        raise InputError(f"{path} is damaged: {error}.") from error
    if len(rows) < vertices or len(polygons) < faces:
        raise InputError(
            f"{path} is cut off: {len(rows)} of {vertices} vertices and {len(polygons)} of {faces} "
            "faces are there."
        )
    if not faces:
        raise InputError(f"{path}: holds no faces; a mesh of triangles is needed.")
    if min(map(len, rows), default=0) < 3 or any(len(p) < 1 + p[0] or p[0] < 0 for p in polygons):
        raise InputError(f"{path} is cut off or damaged: a line has too few numbers.")
    content.parts.append(_part(content, rows, polygons, bool(head[3])))


def _part(
    content: MeshContent, rows: list[list[float]], polygons: list[list[float]], normals: bool
) -> MeshPart:
    points = np.array([row[:3] for row in rows])
    counts = np.array([int(polygon[0]) for polygon in polygons])
    corners = np.array([int(v) for p in polygons for v in p[1 : 1 + int(p[0])]], np.int64)
    triangles, owner = triangulated(corners, counts, points, content.path)
    faces = corners[triangles]
    first = 6 if normals else 3
    colors = _colors(content, [row[first : first + 3] for row in rows], "vertices")
    if colors is not None:
        return MeshPart(points, faces, colors=colors)
    after = [polygon[1 + int(polygon[0]) :][:3] for polygon in polygons]
    colors = _colors(content, after, "faces")
    if colors is None:
        return MeshPart(points, faces)
    split = np.arange(3 * len(faces)).reshape(-1, 3)
    return MeshPart(points[faces].reshape(-1, 3), split, colors=np.repeat(colors[owner], 3, axis=0))


def _colors(content: MeshContent, rows: list[list[float]], what: str) -> NDArray[np.uint8] | None:
    """Colours (N, 3), as fractions or bytes, grey where a row has none; None if no row has one.

    One number alone is the place in a colour map, which is a file of Geomview's. Two are texture
    coordinates.
    """
    given = [k for k, row in enumerate(rows) if len(row) == 3]
    numbered = sum(len(row) == 1 for row in rows)
    if given or numbered:
        content.name("vertex colours" if what == "vertices" else "face colours")
    if numbered:
        content.lost(
            f"{numbered} of {len(rows)} {what} have a colour by its number in a colour map",
            "export it with red, green and blue",
        )
    if not given:
        return None
    without = len(rows) - len(given) - numbered
    if without:
        content.warnings.append(
            f"{without} of {len(rows)} {what} have no colour and are shown grey"
        )
    values = np.array([rows[k] for k in given])
    colors = np.tile(np.array(PLAIN, np.uint8), (len(rows), 1))
    colors[given] = as_bytes(values, 255.0 if values.max(initial=0) <= 1 else 1.0)
    return colors
