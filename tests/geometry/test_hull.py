"""Coarse hulls hold every point and stay near the shape."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial import ConvexHull

from moveit6d.geometry.hull import convex_hull, enclosing_corners


def volume(points: np.ndarray) -> float:
    return float(ConvexHull(points).volume)


@pytest.mark.parametrize("scale", [(1, 1, 1), (1, 0.2, 0.05), (0.01, 3, 3)])
def test_round_shapes_are_held_by_few_corners(scale: tuple[float, float, float]) -> None:
    random = np.random.default_rng(0)
    sphere = random.normal(size=(30_000, 3))
    points = sphere / np.linalg.norm(sphere, axis=1, keepdims=True) * scale + (1, 2, 3)
    corners = enclosing_corners(points, 400)
    assert len(corners) <= 400
    sides = ConvexHull(corners).equations
    assert (points @ sides[:, :3].T + sides[:, 3]).max() < 1e-9
    assert volume(corners) < 1.08 * volume(points)


def test_few_and_flat_points_are_their_own_hull() -> None:
    cube = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], float)
    inside = np.concatenate([cube, cube * 0.5 + 0.2])
    assert len(enclosing_corners(inside)) == 8
    sheet = np.concatenate([cube[:, :2], np.zeros((8, 1))], 1)
    assert len(convex_hull(sheet)) == 4
