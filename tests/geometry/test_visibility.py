"""What a camera can see is told by the object's shape, not by the sphere around it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from moveit6d.geometry.camera import Camera
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.visibility import seen_box, why_unseen
from tests.support import meshes

CAMERA = Camera(300.0, 300.0, 319.5, 239.5, 640, 480)
FISHEYE = replace(
    CAMERA, distortion=(0.05, -0.02, 0.003, -0.001), distortion_model="fisheye", skew=2.0
)
# Its picture turns back at 43 degrees from the axis, within the image.
BARREL = replace(CAMERA, distortion=(-0.38, 0.0, 0.0, 0.0))


def pose(x: float, y: float, z: float) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([x, y, z]).double())


@pytest.mark.parametrize("z", [0.42, 0.30, 0.10])
def test_a_slab_right_before_a_wide_camera_is_seen(z: float) -> None:
    slab = meshes.colored_box((0.6, 0.4, 0.05))
    assert why_unseen(pose(0, 0, z), slab, CAMERA) is None


def test_the_box_of_what_is_seen() -> None:
    slab = meshes.colored_box((0.2, 0.1, 0.02))
    near = 300 / 0.49  # pixels a metre at the side that is turned to the camera
    expected = (319.5 - 0.1 * near, 239.5 - 0.05 * near, 319.5 + 0.1 * near, 239.5 + 0.05 * near)
    assert seen_box(pose(0, 0, 0.5), slab, CAMERA) == pytest.approx(expected, abs=0.1)
    left, _, right, _ = seen_box(pose(0.5, 0, 0.5), slab, CAMERA)
    assert left < 639 < right, "not cut off at the edge"
    behind = seen_box(pose(0, 0, 0.005), slab, CAMERA)  # a part of it is behind the camera
    assert behind[0] < 0 and behind[2] > 640


@pytest.mark.parametrize("z", [0.02, 0.001])
def test_a_camera_inside_the_object_is_told(z: float) -> None:
    slab = meshes.colored_box((0.6, 0.4, 0.05))
    assert "inside the object" in str(why_unseen(pose(0, 0, z), slab, CAMERA))


def test_a_long_bar_beside_the_camera_that_reaches_behind_it() -> None:
    bar = meshes.colored_box((0.05, 0.05, 1.0))
    assert why_unseen(pose(0.1, 0, 0.3), bar, CAMERA) is None
    assert "behind" in str(why_unseen(pose(0.1, 0, -0.6), bar, CAMERA))


def test_the_edge_of_the_image_is_where_the_shape_ends() -> None:
    """OpenCV's projection of the nearest corner is just inside, or just outside."""
    box = meshes.colored_box((0.1, 0.1, 0.1))
    edge = (640 - 319.5) / 300 * 0.95 + 0.05  # x at which the nearest side leaves at z = 0.95
    assert why_unseen(pose(edge - 0.001, 0, 1), box, CAMERA) is None
    far = (640 - 319.5) / 300 * 1.05 + 0.05
    assert "outside of the image" in str(why_unseen(pose(far + 0.001, 0, 1), box, CAMERA))


def test_what_is_too_small_is_named_with_the_units() -> None:
    box = meshes.colored_box((0.1, 0.1, 0.1))
    assert "pixels wide; check the unit" in str(why_unseen(pose(0, 0, 30), box, CAMERA))
    assert why_unseen(pose(0, 0, 5), box, CAMERA) is None


def test_a_sheet_has_no_inside() -> None:
    sheet = meshes.square()
    assert why_unseen(pose(0, 0, 0.01), sheet, CAMERA) is None
    assert np.isfinite(sheet.vertices).all()


@pytest.mark.parametrize("camera", [CAMERA, FISHEYE])
def test_the_edge_is_where_the_lens_shows_it(camera: Camera) -> None:
    """A body so small that its centre stands for it, carried outwards across the image's edge."""
    box = meshes.colored_box((0.02, 0.02, 0.02))
    for x in np.linspace(0.5, 3.0, 26):
        u = float(camera.project(torch.tensor([x, 0.2, 1.0], dtype=torch.float64))[0])
        if abs(u - 639.5) > 6:
            assert (why_unseen(pose(x, 0.2, 1.0), box, camera) is None) == (u < 639.5)


def test_beyond_what_a_lens_shows_there_is_nothing() -> None:
    box = meshes.colored_box((0.02, 0.02, 0.02))
    reach = BARREL.lens.reach if BARREL.lens else 0.0
    assert why_unseen(pose(reach - 0.05, 0, 1), box, BARREL) is None
    assert "lens" in str(why_unseen(pose(reach + 0.05, 0, 1), box, BARREL))
    wide = meshes.colored_box((4.0, 0.4, 0.05))  # both of its ends are beyond
    assert why_unseen(pose(0, 0, 0.5), wide, BARREL) is None
