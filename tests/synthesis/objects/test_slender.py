"""Slender copies: the same triangles and colours, squeezed along the shortest axes."""

from dataclasses import replace

import numpy as np
import pytest

from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.symmetry import ContinuousSymmetry, Symmetries
from moveit6d.synthesis.objects.slender import LEFT, SIZES, slender_copy
from tests.support.pairs import objects


def spreads(mesh: Mesh) -> np.ndarray:
    """Standard deviations along the principal axes, the largest first."""
    points = mesh.vertices - mesh.vertices.mean(0)
    return np.linalg.svd(points.astype(np.float64), compute_uv=False)


def lengths_left(copy: Mesh, mesh: Mesh) -> np.ndarray:
    """Of the principal axes, the longest first, beside that of the longest: 1 if not squeezed."""
    return spreads(copy) / spreads(copy)[0] / (spreads(mesh) / spreads(mesh)[0])


@pytest.mark.parametrize("seed", range(6))
def test_a_slender_copy_is_squeezed_and_keeps_its_colours(seed: int) -> None:
    mesh = objects()[seed % 3]
    copy = slender_copy(np.random.default_rng(seed), mesh)
    left = lengths_left(copy, mesh)
    squeezed = left < LEFT[1] + 1e-3
    assert 1 <= squeezed.sum() <= 2 and not squeezed[0]
    assert left.min() > LEFT[0] - 1e-3
    assert np.array_equal(copy.faces, mesh.faces) and copy.texture is mesh.texture
    assert SIZES[0] * 0.9 < copy.sphere_diameter < SIZES[1] * 1.01


def test_some_are_flat_and_some_are_rods() -> None:
    mesh = objects()[0]
    kinds = []
    for seed in range(20):
        copy = slender_copy(np.random.default_rng(seed), mesh)
        kinds.append(int((lengths_left(copy, mesh) < LEFT[1] + 1e-3).sum()))
    assert {1, 2} == set(kinds)


def test_what_has_symmetries_stays_as_it_is() -> None:
    axis = ContinuousSymmetry(np.array([0.0, 0.0, 1.0]), np.zeros(3))
    mesh = replace(objects()[0], symmetries=Symmetries(continuous=(axis,)))
    assert slender_copy(np.random.default_rng(0), mesh) is mesh
