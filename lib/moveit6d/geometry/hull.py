"""Convex hulls: of points, and coarse ones of few corners around shapes with very many.

Never knows meshes or cameras.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

MOST_CORNERS = 400
BLOCK = 20_000  # points that are compared with all sides at once

Points = NDArray[np.float64]


def convex_hull(points: Points) -> Points:
    """Those of the points (N, 3) that span their convex hull; all of them where they are flat."""
    from scipy.spatial import ConvexHull, QhullError

    try:
        return np.asarray(points[ConvexHull(points).vertices])
    except (QhullError, ValueError):  # flat or tiny: every point counts
        return np.unique(points, axis=0)


def enclosing_corners(points: Points, most: int = MOST_CORNERS) -> Points:
    """At most `most` corners (M, 3) of a convex body that holds all points (N, 3).

    The convex hull itself where it has few corners. Else the farthest points in evenly spread
    directions, moved away from their middle just as far as it takes to hold the others: about a
    hundredth for a sphere.
    """
    hull = convex_hull(points)
    if len(hull) <= most:
        return hull
    middle = hull.mean(0)
    axes, lengths, _ = np.linalg.svd((hull - middle).T, full_matrices=False)
    stretch = axes * np.maximum(lengths, 1e-9 * lengths.max())  # long shapes become round
    round_hull = (hull - middle) @ np.linalg.inv(stretch).T
    chosen = np.unique((round_hull @ _directions(most).T).argmax(0))
    return np.asarray(middle + _grown(round_hull[chosen], round_hull) @ stretch.T)


def _grown(few: Points, hull: Points) -> Points:
    """The corners moved away from their middle until they hold the whole hull."""
    from scipy.spatial import ConvexHull, QhullError

    middle = few.mean(0)
    try:
        sides = ConvexHull(few - middle).equations  # normal · x + offset <= 0 inside
    except (QhullError, ValueError):
        return hull  # flat, so that nothing was gained
    normals = sides[:, :3] / -sides[:, 3:]
    factor = max(
        float(((hull[start : start + BLOCK] - middle) @ normals.T).max())
        for start in range(0, len(hull), BLOCK)
    )
    return np.asarray(middle + max(factor, 1.0) * (few - middle))


def _directions(count: int) -> Points:
    """Unit vectors (count, 3), evenly spread: the spiral of the golden angle."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    angle = k * math.pi * (3 - math.sqrt(5))
    r = np.sqrt(1 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], -1)
