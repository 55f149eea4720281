"""Building blocks: closed where they should be, wound outward, with charts inside their tile."""

from __future__ import annotations

import numpy as np
import pytest

from moveit6d.synthesis.objects import primitives as make
from moveit6d.synthesis.objects.primitives import Part

SOLIDS = {
    "ball": (make.superquadric((1.0, 1.0, 1.0), detail=40), 4 / 3 * np.pi),
    "ellipsoid": (make.superquadric((0.5, 1.0, 2.0), detail=40), 4 / 3 * np.pi),
    "box": (make.box((1.0, 2.0, 3.0)), 6.0),
    "cylinder": (make.cylinder(1.0, 2.0, 64), 2 * np.pi),
    "cone": (make.lathe(np.array([0, 1.0, 0]), np.array([1.0, 0, 0]), 64), np.pi / 3),
}


def volume(part: Part) -> float:
    """Signed: positive where all faces are wound the same way, outward."""
    a, b, c = (part.vertices[part.faces[:, k]] for k in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6)


@pytest.mark.parametrize("name", SOLIDS)
def test_solids_enclose_their_volume(name: str) -> None:
    part, expected = SOLIDS[name]
    assert abs(volume(part)) == pytest.approx(expected, rel=0.03)


@pytest.mark.parametrize("name", SOLIDS)
def test_moves_keep_the_volume(name: str) -> None:
    part, expected = SOLIDS[name]
    turn = make.rotation(np.random.default_rng(1))
    moved = part.turned(turn).moved((1, 2, 3)).moved((-1, -2, -3))
    assert volume(moved) == pytest.approx(volume(part))
    mirrored = part.scaled((-1, 1, 1))
    assert volume(mirrored) == pytest.approx(volume(part))  # faces are turned with it


@pytest.mark.parametrize("name", SOLIDS)
def test_texture_coordinates_fill_the_unit_square(name: str) -> None:
    part, _ = SOLIDS[name]
    assert part.uv.min() >= 0 and part.uv.max() <= 1
    assert np.ptp(part.uv, axis=0).min() > 0.9


def test_tube_runs_along_its_path() -> None:
    path = np.stack([np.linspace(0, 1, 9), np.zeros(9), np.zeros(9)], -1)
    part = make.tube(path, 0.1, 32)
    assert abs(volume(part)) == pytest.approx(np.pi * 0.01, rel=0.03)


def test_prism_has_its_outlines_area() -> None:
    outline = np.array([[1, 1], [-1, 1], [-1, -1], [1, -1]], float)
    assert abs(volume(make.prism(outline, 2.0))) == pytest.approx(8.0, rel=0.1)  # bevelled


def test_join_keeps_everything() -> None:
    a, b = make.box((1, 1, 1)), make.cylinder(1, 1)
    whole = make.join([a, b])
    assert abs(volume(whole)) == pytest.approx(abs(volume(a)) + abs(volume(b)))


def test_rotations_are_right_handed() -> None:
    rng = np.random.default_rng(0)
    for _ in range(20):
        turn = make.rotation(rng)
        np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
        assert np.linalg.det(turn) == pytest.approx(1.0)


def test_deformations_move_equal_points_equally() -> None:
    points = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    twice = np.concatenate([points, points])
    for warped in (
        make.bumps(np.random.default_rng(1), twice, 0.5),
        make.twist(twice, 0.7),
        make.taper(twice, 0.4),
        make.bend(twice, 0.3),
    ):
        np.testing.assert_array_equal(warped[:50], warped[50:])
        assert np.abs(warped - twice).max() > 0.05
