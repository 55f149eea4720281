"""Polygons as triangles: fans where that is right, ears cut off one by one where it is not.

Never adds or moves a vertex.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError

Index = NDArray[np.int64]


def triangulated(
    corners: Index, counts: Index, points: NDArray[np.float64], path: Path
) -> tuple[Index, Index]:
    """Polygons as triangles of positions in `corners`: (T, 3), and the polygon of each (T,).

    Polygon k has `counts[k]` corners, which follow each other in `corners` (vertex numbers of
    `points`). Polygons of fewer than three corners give no triangle.
    `InputError` naming the file if a corner is no vertex.
    """
    if corners.size and (corners.min() < 0 or corners.max() >= len(points)):
        raise InputError(f"{path}: a face names a vertex that is not there ({len(points)} are).")
    starts = np.concatenate([[0], np.cumsum(counts)[:-1]]).astype(np.int64)
    fan_sizes = np.maximum(counts - 2, 0)
    polygon = np.repeat(np.arange(len(counts)), fan_sizes)
    within = np.arange(len(polygon)) - np.repeat(np.cumsum(fan_sizes) - fan_sizes, fan_sizes)
    first = starts[polygon]
    triangles = np.stack([first, first + within + 1, first + within + 2], -1)
    if not (counts > 3).any():
        return triangles, polygon
    bent = _not_convex(corners, triangles, polygon, points)
    if not len(bent):
        return triangles, polygon
    keep = ~np.isin(polygon, bent)
    parts, owners = [triangles[keep]], [polygon[keep]]
    for k in bent.tolist():
        positions = np.arange(starts[k], starts[k] + counts[k])
        ears = _ears(points[corners[positions]])
        parts.append(positions[ears])
        owners.append(np.full(len(ears), k))
    return np.concatenate(parts), np.concatenate(owners)


def _not_convex(
    corners: Index, triangles: Index, polygon: Index, points: NDArray[np.float64]
) -> Index:
    """The polygons whose fan holds a triangle that is turned against the polygon's own normal."""
    a, b, c = (points[corners[triangles[:, k]]] for k in range(3))
    normals = np.cross(b - a, c - a)
    total = np.zeros((int(polygon.max()) + 1, 3))
    np.add.at(total, polygon, normals)
    against = (normals * total[polygon]).sum(1) < 0
    return np.unique(polygon[against])


def _ears(points: NDArray[np.float64]) -> Index:
    """A simple polygon (N, 3) as triangles (N − 2, 3) by cutting ears off, in its own plane."""
    following = np.roll(points, -1, axis=0)
    normal = np.cross(points, following).sum(0)
    drop = int(np.abs(normal).argmax())
    flat = np.delete(points, drop, axis=1)
    area = (flat[:, 0] * np.roll(flat[:, 1], -1) - flat[:, 1] * np.roll(flat[:, 0], -1)).sum()
    sign = 1.0 if area >= 0 else -1.0
    left = list(range(len(points)))
    found = []
    while len(left) > 3:
        ear = next((k for k in range(len(left)) if _is_ear(flat, left, k, sign)), 1)
        n = len(left)
        found.append([left[(ear - 1) % n], left[ear], left[(ear + 1) % n]])
        del left[ear]
    return np.array([*found, left], np.int64)


def _is_ear(flat: NDArray[np.float64], left: list[int], k: int, sign: float) -> bool:
    n = len(left)
    a, b, c = flat[left[k - 1]], flat[left[k]], flat[left[(k + 1) % n]]
    if sign * _turn(a, b, c) <= 0:
        return False
    others = flat[[i for i in left if i not in (left[k - 1], left[k], left[(k + 1) % n])]]
    sides = [sign * _turns(p, q, others) for p, q in ((a, b), (b, c), (c, a))]
    return not ((sides[0] >= 0) & (sides[1] >= 0) & (sides[2] >= 0)).any()


def _turn(a: NDArray[np.float64], b: NDArray[np.float64], c: NDArray[np.float64]) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))


def _turns(
    a: NDArray[np.float64], b: NDArray[np.float64], others: NDArray[np.float64]
) -> NDArray[np.float64]:
    turn: NDArray[np.float64] = (b[0] - a[0]) * (others[:, 1] - a[1]) - (b[1] - a[1]) * (
        others[:, 0] - a[0]
    )
    return turn
