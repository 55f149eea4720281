"""Layers: windows hold the frame's pixels, depth decides, sampling does not shift the image."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3
from moveit6d.rendering.backends import make_renderer
from moveit6d.synthesis.sequences.layers import (
    Layer,
    SceneLight,
    SceneMaterial,
    composite,
    render_layers,
)
from tests.support.meshes import colored_box

CAMERA = Camera(300.0, 310.0, 98.3, 75.1, 200, 150)
LIGHT = SceneLight((0.0, -0.6, -0.8), (0.7, 0.7, 0.7), (0.4, 0.4, 0.4))
MATERIAL = SceneMaterial()


@pytest.fixture(scope="module")
def box() -> Mesh:
    return colored_box((0.12, 0.09, 0.06), (0.02, 0.0, -0.01))


def at(x: float, y: float, z: float, turn: float = 0.5) -> Pose:
    vector = torch.tensor([[turn, -0.7 * turn, 0.3]], dtype=torch.float64)
    return Pose(exp_so3(vector), torch.tensor([[x, y, z]], dtype=torch.float64))


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.5), (0.15, -0.1, 0.6), (-0.17, 0.11, 0.55)])
def test_window_holds_exactly_the_frames_pixels(
    box: Mesh, place: tuple[float, float, float]
) -> None:
    renderer, pose = make_renderer("embree"), at(*place)
    whole = renderer.render([box], pose, CAMERA.matrix[None], size=200).depth[0, 0].numpy()
    frame = np.zeros((150, 200, 3), np.float32)
    depth = np.full((150, 200), np.inf, np.float32)
    for layer in render_layers(
        renderer, box, pose, CAMERA, np.zeros((1, 2)), LIGHT, SceneMaterial()
    ):
        assert len(layer.depth) < 200
        composite(frame, depth, layer)
    expected = np.where(whole[:150] > 0, whole[:150], np.inf)
    assert np.isfinite(expected).sum() > 500
    assert (np.isfinite(depth) != np.isfinite(expected)).sum() <= 2  # rays that graze an edge
    both = np.isfinite(depth) & np.isfinite(expected)
    np.testing.assert_allclose(depth[both], expected[both], atol=1e-5)


def test_outside_of_the_frame_there_is_nothing_to_render(box: Mesh) -> None:
    renderer = make_renderer("embree")
    layers = render_layers(
        renderer, box, at(2.0, 0.0, 0.5), CAMERA, np.zeros((1, 2)), LIGHT, MATERIAL
    )
    assert layers == []


def test_sampling_off_centre_moves_the_picture_back(box: Mesh) -> None:
    renderer, pose = make_renderer("embree"), at(0.0, 0.0, 0.5)
    offsets = np.array([[0.0, 0.0], [0.4, -0.3]])
    both = Pose(pose.rotation.repeat(2, 1, 1), pose.translation.repeat(2, 1))
    first, second = render_layers(renderer, box, both, CAMERA, offsets, LIGHT, MATERIAL)
    shift = _centroid(second) - _centroid(first)
    np.testing.assert_allclose(shift, -offsets[1], atol=0.05)


def test_nearer_layer_wins_whatever_the_order() -> None:
    red, green = (np.broadcast_to(np.float32(c), (4, 4, 3)) for c in ((1, 0, 0), (0, 1, 0)))
    near = Layer(1, 1, red, np.full((4, 4), 0.5, np.float32))
    far = Layer(0, 0, green, np.full((4, 4), 0.7, np.float32))
    pictures = []
    for order in ((near, far), (far, near)):
        frame, depth = np.zeros((4, 4, 3), np.float32), np.full((4, 4), np.inf, np.float32)
        for layer in order:
            composite(frame, depth, layer)
        pictures.append(frame)
    np.testing.assert_array_equal(*pictures)
    assert pictures[0][2, 2].tolist() == [1, 0, 0]
    assert pictures[0][0, 2].tolist() == [0, 1, 0]


def _centroid(layer: Layer) -> np.ndarray:
    y, x = np.nonzero(layer.depth > 0)
    return np.array([x.mean() + layer.left, y.mean() + layer.top])
