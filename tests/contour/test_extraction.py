"""Points along a mask's outline: where they lie, which way is out."""

import numpy as np

from moveit6d.contour.extraction import find_contour

BLUR = 2.0  # pixels


def disc(radius: float, x: float = 63.2, y: float = 62.9) -> np.ndarray:
    row, column = np.mgrid[:128, :128]
    return (column - x) ** 2 + (row - y) ** 2 <= radius**2


def test_a_disc_has_its_radius_and_its_normals() -> None:
    found = find_contour(disc(30.0), 200, BLUR)
    assert found is not None and 190 <= len(found.points) <= 200
    arms = found.points - (63.2, 62.9)
    radius = np.linalg.norm(arms, axis=1)
    # Single points are up to a pixel off, their mean is good to a twentieth.
    assert np.abs(radius - 30).max() < 1
    assert abs(np.average(radius, weights=found.lengths) - 30) < 0.05
    assert ((found.normals * arms).sum(1) / radius > 0.98).all()
    np.testing.assert_allclose(np.linalg.norm(found.normals, axis=1), 1)
    assert disc(30.0)[tuple(found.inside.T)].all()


def test_a_hole_has_an_outline_too() -> None:
    found = find_contour(disc(40.0) & ~disc(15.0), 400, BLUR)
    assert found is not None
    arms = found.points - (63.2, 62.9)
    inner = np.linalg.norm(arms, axis=1) < 25
    assert inner.any() and ((found.normals * arms).sum(1)[inner] < 0).all()


def test_lengths_make_up_for_oblique_outlines() -> None:
    row, column = np.mgrid[:128, :128]
    diamond = np.abs(row - 64) + np.abs(column - 64) < 40  # only oblique sides
    square = (np.abs(row - 64) < 30) & (np.abs(column - 64) < 30)
    halves = np.where(column < 64, diamond, square)
    found = find_contour(halves, 4000, BLUR)
    assert found is not None
    left = found.lengths[found.points[:, 0] < 60].sum() / found.lengths.sum()
    expected = 2 * 40 * 2**0.5 / (2 * 40 * 2**0.5 + 60 + 2 * 30 + 2 * 10)
    assert abs(left - expected) < 0.05


def test_nothing_has_no_outline() -> None:
    assert find_contour(np.zeros((128, 128), bool), 200, BLUR) is None
    assert find_contour(np.ones((128, 128), bool), 200, BLUR) is None
