"""Observations: crops beside renderings, in one place, and their mirror images."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from moveit6d.frame import prepare_frame
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.crop import Crop, View, crop_patch, view_of
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.observation import assemble, mirrored, observe, observe_shared, rotated
from moveit6d.rendering import make_renderer
from tests.support.observations import an_observation

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)


@pytest.mark.parametrize("crop", ["look_at", "axis_parallel"])
def test_an_observation_is_crop_and_rendering_in_one_view(brick: Mesh, crop: Crop) -> None:
    image = np.random.default_rng(0).integers(0, 255, (240, 320, 3), dtype=np.uint8)
    frame, renderer = prepare_frame(image, CAMERA), make_renderer()
    pose = Pose.from_rvec([[0.1, 0.2, 0.3], [0, 0, 0]], [[0.05, 0, 0.7], [0, 0.02, 0.5]])
    size = torch.full((2,), brick.sphere_diameter, dtype=torch.float64)
    found = observe([frame] * 2, [brick] * 2, pose, size, renderer, crop)
    assert len(found) == 2 and 0 < found.mask.mean() < 1
    view = view_of(pose, size, crop)
    for row in range(2):
        one = view[row]
        expected = crop_patch(frame.pixels, one, CAMERA.matrix)
        torch.testing.assert_close(found.image[row], expected)
    assert (found.depth * (1 - found.mask) == 0).all()
    torch.testing.assert_close(found.distance, (view.distance / size).float())


@pytest.mark.parametrize("crop", ["look_at", "axis_parallel"])
def test_a_larger_crop_shows_the_same_in_its_middle(brick: Mesh, crop: Crop) -> None:
    image = np.random.default_rng(0).integers(0, 255, (240, 320, 3), dtype=np.uint8)
    frame, renderer = prepare_frame(image, CAMERA), make_renderer()
    pose = Pose.from_rvec([[0.1, 0.2, 0.3], [0, 0, 0]], [[0.05, 0, 0.7], [0, 0.02, 0.5]])
    enlarged = torch.full((2,), brick.sphere_diameter / 1.6, dtype=torch.float64)
    usual, larger = (
        observe([frame] * 2, [brick] * 2, pose, enlarged, renderer, crop, size)
        for size in (128, 192)
    )
    assert larger.image.shape == (2, 3, 192, 192) and larger.mask.sum() > usual.mask.sum()
    for name in ("image", "rendering", "depth", "mask"):
        middle = getattr(larger, name)[..., 32:-32, 32:-32]
        off = (middle - getattr(usual, name)).abs()
        assert (off < 1e-3).float().mean() > 0.999, "but for edges, where rays miss by a hair"


def test_one_rendering_serves_all_views_in_which_it_is_the_same(brick: Mesh) -> None:
    frame, renderer = prepare_frame(np.zeros((240, 320, 3), np.uint8), CAMERA), make_renderer()
    pose = Pose.from_rvec([[0, 0, 0], [0, 0, 0]], [[0, 0, 0.7], [0, 0, 0.7]])
    size = torch.full((2,), brick.sphere_diameter, dtype=torch.float64)
    view = view_of(pose, size)
    buffer = renderer.render([brick], view.to_virtual(pose)[:1], view.intrinsics[:1])
    shared = observe_shared(frame, buffer, view, size)
    each = observe([frame] * 2, [brick] * 2, pose, size, renderer)
    for name in ("image", "rendering", "depth", "mask", "distance"):
        torch.testing.assert_close(getattr(shared, name), getattr(each, name))
    alone = assemble(
        shared.image[:1], buffer, View(*(p[:1] for p in vars(view).values())), size[:1]
    )
    torch.testing.assert_close(alone.rendering, shared.rendering[:1])


def test_mirror_and_turns_come_back() -> None:
    observation = an_observation(2)
    for there in (mirrored(mirrored(observation)), rotated(rotated(observation, 3), 1)):
        assert torch.equal(there.image, observation.image)
        assert torch.equal(there.depth, observation.depth)
    assert not torch.equal(mirrored(observation).image, observation.image)
    assert observation.channels().shape == (2, 8, 128, 128)
    assert observation.channels(use_depth=False).shape == (2, 7, 128, 128)
