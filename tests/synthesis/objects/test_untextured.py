"""Bare copies: the same shape, in one colour."""

import numpy as np
import pytest

from moveit6d.geometry.mesh import Mesh
from moveit6d.synthesis.objects.untextured import KEPT, untextured_copy
from tests.support.pairs import objects


def contrast(mesh: Mesh) -> float:
    assert mesh.texture is not None
    return float(mesh.texture.reshape(-1, 3).astype(float).std(0).max())


@pytest.mark.parametrize("seed", range(6))
def test_an_untextured_copy_has_the_shape_but_hardly_any_texture(seed: int) -> None:
    mesh = objects()[seed % 3]
    untextured = untextured_copy(np.random.default_rng(seed), mesh)
    assert untextured.vertices is mesh.vertices and untextured.uv is mesh.uv
    assert contrast(untextured) <= KEPT * contrast(mesh) + 1, "a grey level for rounding"


def test_half_of_the_copies_keep_the_mean_colour_of_the_surface() -> None:
    # Red where there are faces, green where there are none: green must not count.
    corners = np.array([[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]])
    faces = np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
    uv = np.array([[0.05, 0.9], [0.4, 0.9], [0.05, 0.1], [0.4, 0.1]])
    texture = np.zeros((64, 64, 3), np.uint8)
    texture[:, :32], texture[:, 32:] = (200, 0, 0), (0, 200, 0)
    mesh = Mesh.from_arrays("half", corners, faces, uv=uv, texture=texture)
    colours = []
    for seed in range(60):
        untextured = untextured_copy(np.random.default_rng(seed), mesh)
        assert untextured.texture is not None
        colours.append(untextured.texture[32, 8].astype(int))
    own = np.abs(np.array(colours) - (200, 0, 0)).max(1) <= 2
    assert own.mean() == pytest.approx(0.5, abs=0.2)


def test_colours_of_vertices_fade_as_well() -> None:
    random = np.random.default_rng(1)
    textured = objects()[0]
    colours = random.integers(0, 255, (len(textured.vertices), 3)).astype(np.uint8)
    mesh = Mesh.from_arrays("painted", textured.vertices, textured.faces, vertex_colors=colours)
    untextured = untextured_copy(random, mesh)
    assert untextured.vertex_colors is not None and mesh.vertex_colors is not None
    assert untextured.vertex_colors.std(0).max() < 0.5 * mesh.vertex_colors.std(0).min()
