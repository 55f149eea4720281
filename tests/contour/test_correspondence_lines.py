"""The distribution along a line: against a plain loop, and where it finds known edges."""

import math

import numpy as np
import pytest

from moveit6d.config import ContourConfig
from moveit6d.contour.correspondence_lines import contour_distances

CONFIG = ContourConfig()
REACH, WINDOW = CONFIG.reach, CONFIG.window


def plain(odds: list[float]) -> tuple[float, float]:
    """Mean and variance in segments, of the log odds of the segments of one line, as written."""
    chances = []
    for displacement in range(-REACH, REACH + 1):
        chance = 1.0
        for k in range(-WINDOW, WINDOW):
            place = k + 0.5
            inside = 1 / (1 + math.exp(-odds[REACH + WINDOW + displacement + k]))
            step = 0.5 - CONFIG.amplitude * math.tanh(place / (2 * CONFIG.slope))
            chance *= inside * step + (1 - inside) * (1 - step)
        chances.append(chance)
    places = range(-REACH, REACH + 1)
    mean = sum(c * d for c, d in zip(chances, places, strict=True)) / sum(chances)
    square = sum(c * (d - mean) ** 2 for c, d in zip(chances, places, strict=True))
    return mean, max(square / sum(chances), CONFIG.min_deviation**2)


@pytest.mark.parametrize("scale", [1, 2])
def test_it_is_what_a_plain_loop_finds(scale: int) -> None:
    odds = np.random.default_rng(0).normal(0, 2, (64, 64)).astype(np.float32)
    # Along the x axis, between pixels where segments are single ones: no interpolation.
    points = np.array([[31.5, 20.0], [30.5, 33.0]])
    normals = np.array([[1.0, 0.0], [-1.0, 0.0]])
    mean, variance = contour_distances(odds, points, normals, scale, CONFIG)
    for i, (x, y) in enumerate(points):
        half = (REACH + WINDOW) * scale
        along = [int(x + normals[i, 0] * (k + 0.5 - half)) for k in range(2 * half)]
        values = odds[int(y), along].reshape(-1, scale).sum(1)
        expected = plain(values.tolist())
        assert (mean[i] / scale, variance[i] / scale**2) == pytest.approx(expected, rel=1e-4)


@pytest.mark.parametrize("shift", [-3, 0, 2])
def test_an_edge_is_found_where_it_is(shift: int) -> None:
    odds = np.full((64, 64), -3.0, np.float32)
    odds[:, : 32 + shift] = 3
    points, normals = np.full((5, 2), 31.5), np.tile([1.0, 0.0], (5, 1))
    mean, variance = contour_distances(odds, points, normals, 1, CONFIG)
    # Steps that smooth leave some chance to displacements beside, cut off at the reach.
    np.testing.assert_allclose(mean, shift, atol=0.25)
    assert (variance < 3).all()


def test_colours_that_say_nothing_move_nothing() -> None:
    points, normals = np.full((3, 2), 31.5), np.tile([0.6, 0.8], (3, 1))
    mean, variance = contour_distances(np.zeros((64, 64), np.float32), points, normals, 2, CONFIG)
    np.testing.assert_allclose(mean, 0, atol=1e-9)
    np.testing.assert_allclose(variance, 4 * ((2 * REACH + 1) ** 2 - 1) / 12)
