"""What is known must agree: with given poses, with itself, and with what is found."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
import trimesh

from moveit6d import Camera, InputError, Mesh, Pose
from moveit6d.config import RegionConfig
from moveit6d.estimation.detection import SearchRegion
from moveit6d.estimation.detection.agreement import disagreement, given_poses
from moveit6d.geometry.visibility import seen_box

CAMERA = Camera(500.0, 500.0, 319.5, 239.5, 640, 480)
CONFIG = RegionConfig()
BOX = (267.0, 203.0, 105.0, 74.0)  # of the box mesh at half a metre


def at(x: float, z: float) -> Pose:
    """Centred."""
    return Pose(torch.eye(3).double(), torch.tensor([x, 0.0, z]).double())


def test_distances_are_rough(box: Mesh) -> None:
    radius = box.sphere_diameter / 2
    for z, agrees in ((0.5, True), (1.0, True), (0.45, True), (1.09 + radius, True),
                      (0.4 - radius, False), (1.12 + radius, False)):  # fmt: skip
        found = disagreement(SearchRegion(distance=(0.5, 1.0)), box, CAMERA, at(0, z))
        assert (found is None) == agrees, z
    said = disagreement(SearchRegion(distance=(5, 6)), box, CAMERA, at(0, 0.5))
    assert said == "distance 5 6 contradict each other: by the pose the object is 0.5 m away"


@pytest.mark.parametrize("is_mask", [False, True])
def test_boxes_and_masks_are_rough(box: Mesh, is_mask: bool) -> None:
    x, y, width, height = BOX
    for moved, scale, agrees in (
        (0, 1, True), (50, 1, True), (0, 1.7, True), (0, 0.3, True),  # a part, the others hide
        (100, 1, False), (-200, 1, False), (0, 2.2, False),
    ):  # fmt: skip
        rough = (
            x + moved - (scale - 1) * width / 2, y - (scale - 1) * height / 2,
            scale * width, scale * height,
        )  # fmt: skip
        known = SearchRegion(box=rough)
        if is_mask:
            mask = np.zeros((480, 640), bool)
            left, top, wide, high = (round(number) for number in rough)
            mask[top : top + high, left : left + wide] = True
            known = SearchRegion(mask=mask)
        found = disagreement(known, box, CAMERA, at(0, 0.5))
        assert (found is None) == agrees, (moved, scale)
    assert disagreement(SearchRegion(), box, CAMERA, at(0, 0.5)) is None


def points_at(mesh: Mesh, pose: Pose) -> np.ndarray:
    places = mesh.vertices[::5].astype(np.float64) + mesh.center
    pixels = CAMERA.project(pose.transform(torch.from_numpy(places))).numpy()
    return np.hstack([pixels, places])


@pytest.mark.parametrize(
    ("known", "words"),
    [
        ({"distance": (2, 3)}, r"and distance 2 3 contradict.* is 0\.5 m away; leave one of them"),
        ({"box": (0, 0, 40, 40)}, r"and box 0 0 40 40 contradict each other.* at 267 203 105 74"),
    ],
)
@pytest.mark.parametrize("name", ["start pose", "points"])
def test_a_given_pose_that_contradicts_the_rest_is_refused(
    box: Mesh, known: dict[str, Any], words: str, name: str
) -> None:
    pose = box.outer(at(0, 0.5))
    near, points = (pose, None) if name == "start pose" else (None, points_at(box, pose))
    region = replace(SearchRegion.checked(CAMERA, **known), near=near)
    with pytest.raises(InputError, match=f"^{name} {words}"):
        given_poses(region, box, CAMERA, points, 1, CONFIG)
    right = SearchRegion(box=BOX, distance=(0.4, 0.6), near=near)
    assert given_poses(right, box, CAMERA, points, 1, CONFIG)


def test_a_start_is_rougher_than_points(box: Mesh) -> None:
    pose = box.outer(at(0, 0.5))
    far = SearchRegion(distance=(0.7, 0.8))
    assert given_poses(replace(far, near=pose), box, CAMERA, None, 1, CONFIG) == [pose]
    with pytest.raises(InputError, match=r"^points and distance"):
        given_poses(far, box, CAMERA, points_at(box, pose), 1, CONFIG)


def test_points_are_of_one_instance(box: Mesh) -> None:
    points = points_at(box, box.outer(at(0, 0.5)))
    with pytest.raises(InputError, match="points are of one instance, and 3 are looked for"):
        given_poses(SearchRegion(), box, CAMERA, points, 3, CONFIG)


def test_a_box_that_is_too_large_for_a_distance_is_refused(box: Mesh) -> None:
    known = SearchRegion(box=BOX, distance=(2, 2.5))
    words = (
        r"^distance 2 2\.5 and box con.*even at 2 m the object would be no more than \d\d % as long"
    )
    with pytest.raises(InputError, match=words):
        given_poses(known, box, CAMERA, None, 1, CONFIG)
    hidden = SearchRegion(box=(310, 230, 20, 20), distance=(0.4, 0.6))  # a part of it is seen
    assert given_poses(hidden, box, CAMERA, None, 1, CONFIG) == []


WIDE = Camera.from_fov(110, 1280, 1280)
FISHEYE = Camera(400, 400, 639.5, 479.5, 1280, 960, (0.02, -0.005, 0.001, -0.0002), "fisheye")


def aside(degrees: float, distance: float) -> Pose:
    angle = np.radians(degrees)
    return at(distance * np.sin(angle), distance * np.cos(angle))


def ball() -> Mesh:
    sphere = trimesh.creation.icosphere(3, 0.05)
    return Mesh.from_arrays("ball", sphere.vertices, sphere.faces)


@pytest.mark.parametrize(("camera", "degrees"), [(WIDE, 48), (FISHEYE, 50), (FISHEYE, 55)])
def test_far_from_the_axis_things_are_longer(camera: Camera, degrees: float) -> None:
    mesh = ball()
    left, top, right, bottom = seen_box(aside(degrees, 0.6), mesh, camera)
    box = (left, top, right - left, bottom - top)
    for distance, agrees in (((0.57, 0.63), True), ((1.8, 2.0), False)):
        known = SearchRegion.checked(camera, box=box, distance=distance).undistorted(camera)
        if agrees:
            assert given_poses(known, mesh, camera, None, 1, CONFIG) == []
            continue
        with pytest.raises(InputError, match=r"distance 1\.8 2 and box contradict each other"):
            given_poses(known, mesh, camera, None, 1, CONFIG)


def test_far_from_the_axis_a_start_may_be_as_many_widths_aside() -> None:
    mesh = ball()
    left, top, right, bottom = seen_box(aside(48, 0.6), mesh, WIDE)
    known = SearchRegion(box=(left, top, right - left, bottom - top))
    near = aside(37, 0.6)
    assert disagreement(known, mesh, WIDE, near, CONFIG.near_shift) is None
    assert disagreement(known, mesh, WIDE, near) is not None


def test_a_lens_is_undone_before(box: Mesh) -> None:
    camera = replace(CAMERA, distortion=(-0.2, 0.05, 0.0, 0.0))
    pose = box.outer(at(0.2, 0.5))
    places = torch.from_numpy(box.vertices[::5].astype(np.float64) + box.center)
    pixels = camera.project(pose.transform(places)).numpy()
    low, size = pixels.min(0), np.ptp(pixels, axis=0)
    known = SearchRegion.checked(camera, box=(*low, *size)).undistorted(camera)
    rows = np.hstack([pixels, places.numpy()])
    (found, *_) = given_poses(known, box, camera, rows, 1, CONFIG)
    assert (found.translation - pose.translation).abs().max() < 1e-4


def test_with_a_lens_a_contradiction_is_said_in_the_pixels_of_the_image_taken(box: Mesh) -> None:
    camera = replace(CAMERA, distortion=(-0.2, 0.05, 0.0, 0.0))
    assert camera.full_pinhole != camera.pinhole
    pose = box.outer(at(0.2, 0.5))
    u, v = camera.project(at(0.2, 0.5).translation).tolist()
    known = SearchRegion.checked(camera, box=(0, 0, 40, 40), near=pose).undistorted(camera)
    words = f"^start pose and box contradict each other.* is at pixel {u:.0f}, {v:.0f}; leave one"
    with pytest.raises(InputError, match=words):
        given_poses(known, box, camera, None, 1, CONFIG)
