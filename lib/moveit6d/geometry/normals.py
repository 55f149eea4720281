"""Surface normals from positions and triangles, smooth across the seams of a texture.

Never reads the normals stored in a file: they are often missing and sometimes wrong.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

CREASE_DEGREES = 50.0  # an edge sharper than this stays an edge
MAX_PAIRS = 30_000_000  # corners that meet in one place, in pairs; beyond it no creases are kept


def face_normals(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    """Unit normal of each triangle, (F, 3); zero for triangles without area."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    return _unit(np.cross(b - a, c - a))


def smooth_normals(
    vertices: NDArray[np.float64], faces: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Normals of vertices (V, 3), smooth everywhere, and of corners (F, 3, 3), creases kept.

    Vertices at one position count as one, however often a file repeats them. Faces are weighted by
    the angle that they have there, so that the answer does not depend on the triangulation.
    """
    normals = face_normals(vertices, faces)
    weighted = (_corner_angles(vertices, faces)[..., None] * normals[:, None]).reshape(-1, 3)
    place = _places(vertices)  # (V,)
    corner_place = place[faces].reshape(-1)  # (3F,)
    count = int(place.max()) + 1
    summed = _sum_by(corner_place, weighted, count)
    # Where all faces cancel (both sides of a sheet), any of them is better than nothing.
    fallback = np.zeros((count, 3))
    fallback[corner_place] = np.repeat(normals, 3, axis=0)
    small = np.linalg.norm(summed, axis=1) < 1e-6
    summed[small] = fallback[small]
    vertex_normals = _unit(summed)[place]
    corner = _corner_normals(corner_place, normals, weighted, count)
    return vertex_normals, vertex_normals[faces] if corner is None else corner


def _corner_normals(
    corner_place: NDArray[np.int64],
    normals: NDArray[np.float64],
    weighted: NDArray[np.float64],
    count: int,
) -> NDArray[np.float64] | None:
    """Each corner's mean over the faces that meet it there without a crease: (F, 3, 3)."""
    here = np.bincount(corner_place, minlength=count)  # corners at each place
    if int((here.astype(np.int64) ** 2).sum()) > MAX_PAIRS:
        return None
    order = np.argsort(corner_place, kind="stable")  # corners, place by place
    start = np.cumsum(here) - here
    repeats = here[corner_place]  # partners of each corner, itself among them
    corner = np.repeat(np.arange(len(corner_place)), repeats)
    rank = np.arange(len(corner)) - np.repeat(np.cumsum(repeats) - repeats, repeats)
    partner = order[start[corner_place[corner]] + rank]
    alike = np.einsum("ij,ij->i", normals[corner // 3], normals[partner // 3])
    keep = alike > math.cos(math.radians(CREASE_DEGREES))
    summed = _sum_by(corner[keep], weighted[partner[keep]], len(corner_place))
    return _unit(summed).reshape(-1, 3, 3)


def _corner_angles(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> NDArray[np.float64]:
    corners = vertices[faces]  # (F, 3, 3)
    ahead = _unit(np.roll(corners, -1, axis=1) - corners)
    back = _unit(np.roll(corners, 1, axis=1) - corners)
    cosine = np.einsum("fij,fij->fi", ahead, back)
    return np.asarray(np.arccos(cosine.clip(-1, 1)))


def _places(vertices: NDArray[np.float64]) -> NDArray[np.int64]:
    """A number for each vertex, the same for vertices at the same position."""
    size = float(np.ptp(vertices, axis=0).max())
    rounded = np.rint(vertices / (size * 1e-6 or 1.0)).astype(np.int64)
    return np.asarray(np.unique(rounded, axis=0, return_inverse=True)[1]).reshape(-1)


def _sum_by(
    index: NDArray[np.int64], values: NDArray[np.float64], count: int
) -> NDArray[np.float64]:
    columns = [np.bincount(index, values[:, k], minlength=count) for k in range(3)]
    return np.stack(columns, axis=-1)


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(length > 0, length, 1.0)
