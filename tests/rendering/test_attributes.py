"""Attributes of a surface at the points that rays meet."""

import gc

import numpy as np
import torch

from moveit6d.rendering import attributes, embree
from tests.support import meshes
from tests.support.drawing import RENDERER, arrays, draw


def test_normals_of_a_sphere_are_the_closed_form_s():
    mesh = meshes.sphere(0.05)
    pose, intrinsics = meshes.view(mesh, seed=1, offset=(0.01, 0.02))
    _, normal, depth, mask = arrays(RENDERER.render([mesh], pose, intrinsics))
    grid = np.stack(np.meshgrid(np.arange(128), np.arange(128)), -1)
    rays = (
        np.concatenate([grid, np.ones((128, 128, 1))], -1) @ torch.inverse(intrinsics[0]).numpy().T
    )
    points = rays * depth[..., None]
    expected = (points - pose.translation[0].numpy()) / 0.05
    hit = mask > 0
    cosine = (normal * expected).sum(-1)[hit] / np.linalg.norm(expected, axis=-1)[hit]
    assert np.degrees(np.arccos(cosine.min().clip(-1, 1))) < 1.5  # facets of about 1.5 degrees
    np.testing.assert_allclose(np.linalg.norm(normal[hit], axis=-1), 1, atol=1e-5)
    assert ((normal * rays).sum(-1)[hit] < 1e-4).all()
    assert (normal[~hit] == 0).all()


def test_vertex_colours_are_interpolated():
    colors = np.array([[0, 0, 0], [200, 0, 0], [200, 200, 0], [0, 200, 0]], np.uint8)
    albedo, _, _, mask = draw(meshes.square(colors=colors))
    rows, columns = np.nonzero(mask)
    across = (columns - columns.min() + 0.5) / (np.ptp(columns) + 1)
    down = (rows - rows.min() + 0.5) / (np.ptp(rows) + 1)
    np.testing.assert_allclose(albedo[mask > 0][:, 0] * 255, 200 * across, atol=4)
    np.testing.assert_allclose(albedo[mask > 0][:, 1] * 255, 200 * down, atol=4)


def test_what_is_built_for_a_mesh_goes_with_it():
    mesh = meshes.colored_box()
    draw(mesh)
    assert mesh in embree._TREES and mesh in attributes._KEPT
    before = len(embree._TREES), len(attributes._KEPT)
    del mesh
    gc.collect()
    assert len(embree._TREES) < before[0] and len(attributes._KEPT) < before[1]
