"""The look-at crop: where things land in the patch, exactness of the homography, gradients."""

import cv2
import numpy as np
import pytest
import torch

from moveit6d.geometry.camera import Camera, project
from moveit6d.geometry.crop import (
    OBJECT_SIZE,
    PATCH_SIZE,
    Crop,
    View,
    axis_parallel,
    crop_homography,
    crop_patch,
    crop_patches,
    look_at,
    patch_to_image,
    view_of,
)
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import random_rotations

CAMERA = Camera(600, 590, 315, 245, 640, 480)
CROPS: tuple[Crop, ...] = ("look_at", "axis_parallel")
DIAMETER = torch.tensor(0.2, dtype=torch.float64)


def some_poses(count: int) -> Pose:
    generator = torch.Generator().manual_seed(0)
    place = torch.rand(count, 3, dtype=torch.float64, generator=generator) - 0.5
    place = place * torch.tensor([0.8, 0.6, 0.4]) + torch.tensor([0.0, 0, 1])
    return Pose(random_rotations(count, generator), place)


def test_the_object_stands_straight_ahead() -> None:
    pose = some_poses(100)
    view = look_at(pose, DIAMETER.expand(100))
    seen = view.to_virtual(pose)
    assert seen.translation[:, :2].abs().max() < 1e-12
    assert torch.allclose(seen.translation[:, 2], pose.translation.norm(dim=-1))
    assert torch.allclose(view.to_real(seen).matrix, pose.matrix, atol=1e-12)


def test_axis_parallel_views_are_cut_out_with_the_object_in_the_middle() -> None:
    """No turn; the centre projects to the patch's middle, a radius beside it half its width."""
    pose = some_poses(100)
    view = axis_parallel(pose, DIAMETER.expand(100))
    assert torch.equal(view.to_virtual(pose).translation, pose.translation)
    middle = project(pose.translation[:, None], view.intrinsics)[:, 0]
    assert torch.allclose(middle, torch.full((100, 2), (PATCH_SIZE - 1) / 2).double())
    beside = pose.translation + torch.tensor([0.0, 1.0, 0.0]).double() * DIAMETER / 2
    edge = project(beside[:, None], view.intrinsics)[:, 0]
    assert torch.allclose(edge - middle, torch.tensor([0.0, OBJECT_SIZE / 2]).double())
    homography = crop_homography(view, CAMERA.matrix.double())
    # With square pixels it is a square: nothing but one scale and a shift.
    assert torch.allclose(homography[:, 2], torch.tensor([0.0, 0.0, 1.0]).double())
    assert homography[:, [0, 1], [1, 0]].abs().max() < 1e-12


def test_both_kinds_of_crop_are_the_same_in_the_middle_of_the_image() -> None:
    ahead = Pose(torch.eye(3).double(), torch.tensor([0.0, 0.0, 0.7]).double())
    one, other = (view_of(ahead, DIAMETER, crop) for crop in CROPS)
    assert torch.equal(one.rotation, other.rotation)
    torch.testing.assert_close(one.intrinsics, other.intrinsics)
    assert one.distance == other.distance and (one.axis == 0).all()


@pytest.mark.parametrize("crop", CROPS)
def test_patches_go_back_to_the_image(crop: Crop) -> None:
    view = view_of(some_poses(20), DIAMETER.expand(20), crop)
    matrix = CAMERA.matrix.double()
    both = crop_homography(view, matrix) @ patch_to_image(view, matrix)
    torch.testing.assert_close(both / both[:, 2:, 2:], torch.eye(3).double().expand(20, 3, 3))


def test_the_turn_has_no_roll() -> None:
    """The smallest turn that points at the object: its axis lies in the image plane."""
    view = look_at(some_poses(100), DIAMETER.expand(100))
    antisymmetric = view.rotation[:, 1, 0] - view.rotation[:, 0, 1]
    assert antisymmetric.abs().max() < 1e-12
    assert torch.allclose(torch.linalg.det(view.rotation), torch.ones(100, dtype=torch.float64))


def test_the_sphere_is_as_wide_as_stated() -> None:
    """A point one radius beside the centre lands half of 128 / 1.4 pixels from the middle."""
    pose = some_poses(1)
    view = look_at(pose, DIAMETER[None])
    beside = torch.stack([torch.zeros(1), DIAMETER[None] / 2, view.distance], -1)[:, None]
    pixel = project(beside, view.intrinsics)[0, 0]
    middle = (PATCH_SIZE - 1) / 2
    assert torch.allclose(pixel, torch.tensor([middle, middle + OBJECT_SIZE / 2]).double())


def test_the_homography_sends_projections_to_projections() -> None:
    """A point's pixel in the image maps to its pixel in the virtual camera, anywhere."""
    pose = some_poses(20)
    view = look_at(pose, DIAMETER.expand(20))
    points = torch.randn(20, 30, 3, dtype=torch.float64) * 0.05 + pose.translation[:, None]
    image = CAMERA.project(points)
    homography = crop_homography(view, CAMERA.matrix)
    mapped = torch.nn.functional.pad(image, (0, 1), value=1.0) @ homography.mT
    expected = project(points @ view.rotation.mT, view.intrinsics)
    assert torch.allclose(mapped[..., :2] / mapped[..., 2:], expected, atol=1e-8)


def test_the_way_back_is_the_inverse() -> None:
    view = look_at(some_poses(20), DIAMETER.expand(20))
    product = crop_homography(view, CAMERA.matrix) @ patch_to_image(view, CAMERA.matrix)
    torch.testing.assert_close(product, torch.eye(3).double().expand(20, 3, 3))


def test_patches_agree_with_opencv() -> None:
    """kornia's warp against OpenCV's with the same matrix: pixel centres are whole numbers."""
    random = np.random.default_rng(0)
    image = cv2.GaussianBlur(random.random((480, 640, 3)).astype(np.float32), (0, 0), 4)
    pose = some_poses(4)
    view = look_at(pose, DIAMETER.expand(4))
    matrix = CAMERA.matrix.expand(4, 3, 3)
    tensor = torch.from_numpy(image).permute(2, 0, 1).expand(4, 3, 480, 640)
    patches = crop_patches(tensor, view, matrix)
    for patch, homography in zip(patches, crop_homography(view, matrix), strict=True):
        expected = cv2.warpPerspective(image, homography.numpy(), (PATCH_SIZE, PATCH_SIZE))
        inside = slice(3, -3)
        difference = patch.permute(1, 2, 0).numpy() - expected
        assert np.abs(difference[inside, inside]).max() < 0.02


@pytest.mark.parametrize("depth", [0.25, 0.5, 1.0, 3.0])
def test_one_patch_is_where_it_should_be_at_every_scale(depth: float) -> None:
    """A blob at a known 3D point lands on the point's pixel, averaged down or enlarged."""
    camera = Camera(1200, 1200, 639.5, 479.5, 1280, 960)
    pose = Pose(torch.eye(3).double(), torch.tensor([0.05, -0.03, depth], dtype=torch.float64))
    view = look_at(pose, DIAMETER)
    point = pose.translation + torch.tensor([0.03, 0.02, 0.0]).double()
    u, v = camera.project(point).tolist()
    x, y = np.meshgrid(np.arange(1280), np.arange(960))
    width = 3 * max(1.0, 1200 / float(view.intrinsics[0, 0]))
    image = np.exp(-((x - u) ** 2 + (y - v) ** 2) / (2 * width**2))
    pixels = torch.from_numpy((image * 255).astype(np.uint8)).expand(3, 960, 1280)
    patch = crop_patch(pixels, view, camera.matrix)[0].double().numpy()
    x, y = np.meshgrid(np.arange(PATCH_SIZE), np.arange(PATCH_SIZE))
    found = [(patch * x).sum() / patch.sum(), (patch * y).sum() / patch.sum()]
    expected = project((view.rotation @ point)[None], view.intrinsics)[0].tolist()
    # Perspective makes a blob a little lopsided, so its centroid is not exactly the point.
    assert np.allclose(found, expected, atol=0.1)


def test_outside_of_the_image_is_black() -> None:
    image = torch.full((3, 480, 640), 255, dtype=torch.uint8)
    pose = Pose(torch.eye(3).double(), torch.tensor([0.5, 0.0, 1.0]).double())
    patch = crop_patch(image, look_at(pose, DIAMETER), CAMERA.matrix)
    assert patch[:, 64, 10].min() > 0.9 and patch[:, 64, -10].max() == 0


def test_gradients_reach_the_image_and_the_pose() -> None:
    generator = torch.Generator().manual_seed(0)
    image = torch.rand(1, 3, 48, 64, generator=generator, requires_grad=True)
    place = torch.tensor([[0.02, 0.01, 1.0]], dtype=torch.float64, requires_grad=True)
    pose = Pose(torch.eye(3).double()[None], place)
    view = look_at(pose, DIAMETER[None])
    matrix = Camera(60, 60, 31.5, 23.5, 64, 48).matrix[None]
    crop_patches(image, view, matrix).square().sum().backward()
    assert image.grad is not None and image.grad.abs().max() > 0
    assert place.grad is not None and place.grad.abs().min() > 0


def test_views_turn_back_and_forth() -> None:
    pose = some_poses(5)
    view = look_at(pose, DIAMETER.expand(5))
    assert isinstance(view, View)
    back = view.to_virtual(view.to_real(pose))
    assert torch.allclose(back.matrix, pose.matrix, atol=1e-12)
