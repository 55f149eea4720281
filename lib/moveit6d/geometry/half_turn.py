"""Half turns of an object about the axes of its smallest box: what looks most like the object.

Never sees an image. Cartons, tools and bottles fill nearly the same outline upside down.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .hull import convex_hull

Numbers = NDArray[np.float64]


def half_turns(points: Numbers) -> Numbers:
    """Motions (3, 4, 4) of points (N, 3), one about each axis of the smallest box around them.

    They leave the box as it is.

    >>> corners = np.array(np.meshgrid([0, 1], [0, 2], [0, 5])).T.reshape(-1, 3).astype(float)
    >>> sorted(np.abs(half_turns(corners) @ [0, 0, 0, 1]).round(6)[:, :3].tolist())
    [[0.0, 2.0, 5.0], [1.0, 0.0, 5.0], [1.0, 2.0, 0.0]]
    """
    to_box = _to_box(points)
    back = np.linalg.inv(to_box)
    turns = np.stack([np.diag([*row, 1.0]) for row in 2 * np.eye(3) - 1])
    return np.asarray(back @ turns @ to_box)


def _to_box(points: Numbers) -> Numbers:
    """The motion (4, 4) that brings the smallest box of points to the axes, its centre to zero."""
    from scipy.spatial import QhullError
    from trimesh.bounds import oriented_bounds

    corners = convex_hull(points)
    try:
        return np.asarray(oriented_bounds(corners)[0], np.float64)
    except (QhullError, ValueError):  # flat: the axes of its spread
        axes = np.linalg.svd(corners - corners.mean(0), full_matrices=True)[2]
        axes[2] *= np.linalg.det(axes)
        placed = corners @ axes.T
        motion = np.eye(4)
        motion[:3, :3], motion[:3, 3] = axes, -0.5 * (placed.min(0) + placed.max(0))
        return motion
