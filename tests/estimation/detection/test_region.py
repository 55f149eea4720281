"""Regions: what a box, a mask, a distance and a nearby pose leave of a search."""

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
from moveit6d.estimation.detection.region import widening
from moveit6d.geometry.visibility import seen_box

CAMERA = Camera(500.0, 500.0, 319.5, 239.5, 640, 480)
SHARES = (0.1, 0.75)
EDGE = (1 + (319.5 / 500) ** 2) ** 0.75  # how much wider things are seen at the image's edge
WIDE = Camera.from_fov(110, 1280, 1280)


def at(mesh: Mesh, x: float, y: float, z: float) -> Pose:
    place = torch.tensor([x, y, z], dtype=torch.float64)
    return mesh.outer(Pose(torch.eye(3, dtype=torch.float64), place))


def test_nothing_known_is_the_whole_image(box: Mesh) -> None:
    region = SearchRegion()
    assert region.empty and region.window(box, CAMERA, 100) is None
    assert region.widths(box, CAMERA, SHARES) == (48.0, 360.0)
    pixels, sizes = torch.tensor([[0.0, 0.0], [639.0, 479.0]]), torch.tensor([50.0, 300.0])
    assert region.allows(box, CAMERA, pixels, sizes, torch.zeros(2, 4)).all()


def test_a_distance_is_a_width(box: Mesh) -> None:
    low, high = SearchRegion(distance=(0.5, 1.0)).widths(box, CAMERA, SHARES)
    assert low == pytest.approx(500 * box.sphere_diameter)
    assert high == pytest.approx(1000 * box.sphere_diameter * EDGE)


def test_a_box_bounds_width_and_place(box: Mesh) -> None:
    region = SearchRegion(box=(200.0, 100.0, 80.0, 60.0))
    low, high = region.widths(box, CAMERA, SHARES)
    assert low == pytest.approx(68.0) and high == pytest.approx(200.0)
    left, top, right, bottom = region.window(box, CAMERA, 100) or (0, 0, 0, 0)
    assert (left, top, right, bottom) == (140, 40, 340, 220)
    # A silhouette of 0.8 × 0.6 widths: it fills the box at its centre with width 100.
    edges = torch.tensor([[-0.4, -0.3, 0.4, 0.3]]).expand(3, 4)
    pixels = torch.tensor([[240.0, 130.0], [240.0, 130.0], [300.0, 130.0]])
    sizes = torch.tensor([100.0, 190.0, 100.0])
    assert region.allows(box, CAMERA, pixels, sizes, edges).tolist() == [True, False, False]


def test_a_mask_is_its_box(box: Mesh) -> None:
    mask = np.zeros((480, 640), bool)
    mask[100:160, 200:280] = True
    region = SearchRegion.checked(CAMERA, mask=mask)
    assert region.bounds == (199.5, 99.5, 80.0, 60.0)


def test_a_box_and_a_mask_of_two_places_contradict_each_other() -> None:
    mask = np.zeros((480, 640), np.uint8)
    mask[100:200, 50:150] = 1
    for box in ((60, 110, 80, 80), (0, 0, 640, 480), (130, 100, 20, 100), (100, 50, 100, 100)):
        region = SearchRegion.checked(CAMERA, box, mask)
        if box == (100, 50, 100, 100):  # a quarter of each in common
            with pytest.raises(InputError, match="box and mask contradict each other: 26 % of"):
                region.check_common(RegionConfig())
        else:
            region.check_common(RegionConfig())


def test_near_is_around_the_pose(box: Mesh) -> None:
    near = at(box, 0.1, 0.0, 0.5)
    region = SearchRegion(near=near)
    width = 500 * box.sphere_diameter / float(box.inner(near).translation.norm())
    assert region.widths(box, CAMERA, SHARES) == pytest.approx((width / 1.5, width * 1.5), rel=0.04)
    pixels = torch.tensor([[419.5, 239.5], [419.5 + 0.7 * width, 239.5], [319.5, 400.0]])
    allowed = region.allows(box, CAMERA, pixels, torch.full((3,), width), torch.zeros(3, 4))
    assert allowed.tolist() == [True, True, False]
    window = region.window(box, CAMERA, width)
    assert window is not None and window[0] > 0 and window[2] <= 640
    wide = RegionConfig(near_shift=0.65, near_ratio=2.0)
    low, high = region.widths(box, CAMERA, SHARES, wide)
    assert (low, high) == pytest.approx((width / 2, width * 2), rel=0.04)
    sizes = torch.full((3,), width)
    allowed = region.allows(box, CAMERA, pixels, sizes, torch.zeros(3, 4), wide)
    assert allowed.tolist() == [True, False, False]


def test_what_is_known_of_the_width_is_searched_however_large_the_image(box: Mesh) -> None:
    large = CAMERA.resize(3840, 2880)
    shares = (SHARES[0] * 2880, SHARES[1] * 2880)
    assert SearchRegion().widths(box, large, SHARES) == pytest.approx(shares)
    for z in (0.15, 4.0):  # wider and narrower than what is looked for where nothing is known
        near = at(box, 0.0, 0.0, z)
        width = large.fx * box.sphere_diameter / float(box.inner(near).translation.norm())
        assert not shares[0] < width < shares[1]
        low, high = SearchRegion(near=near).widths(box, large, SHARES)
        assert (low, high) == pytest.approx((max(48.0, width / 1.5), width * 1.5), rel=0.02)
    small = SearchRegion(box=(1000.0, 900.0, 80.0, 60.0)).widths(box, large, SHARES)
    assert small == pytest.approx((0.85 * 80, 2.5 * 80))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"box": (0, 0, 10)}, "4 finite numbers"),
        ({"box": (0, 0, 2, 50)}, "at least 4 wide"),
        ({"box": (700, 0, 50, 50)}, "inside the image of 640×480"),
        ({"box": ("a", 0, 50, 50)}, "4 numbers"),
        ({"mask": np.ones((10, 10))}, "480 rows of 640"),
        ({"mask": np.zeros((480, 640))}, "fewer than 16"),
        ({"distance": (1.0, 0.5)}, "nearer first"),
        ({"distance": (0.0, float("nan"))}, "finite"),
    ],
)
def test_what_cannot_be_right_is_refused(given: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        SearchRegion.checked(CAMERA, **given)


def test_a_box_may_be_the_visible_part_of_a_covered_object(box: Mesh) -> None:
    region = SearchRegion(box=(200.0, 100.0, 40.0, 60.0))  # the left half of 80 × 60
    edges = torch.tensor([[-0.4, -0.3, 0.4, 0.3]]).expand(2, 4)
    sizes = torch.tensor([100.0, 100.0])
    pixels = torch.tensor([[240.0, 130.0], [275.0, 130.0]])  # over it, and beside it
    assert region.allows(box, CAMERA, pixels, sizes, edges).tolist() == [True, False]


def test_who_is_taken_is_not_looked_at(box: Mesh) -> None:
    near = at(box, 0.0, 0.0, 1.0)
    region = SearchRegion(taken=(near,))
    assert not region.empty and region.window(box, CAMERA, 100) is None
    assert region.widths(box, CAMERA, SHARES) == SearchRegion().widths(box, CAMERA, SHARES)
    width = 500 * box.sphere_diameter
    aside = torch.tensor([0.0, 0.39, 0.41, 0.41]) * width
    pixels = torch.stack([319.5 + aside, torch.full((4,), 239.5)], 1)
    # The wider of the two counts: the last candidate is nearer than the one that is taken.
    sizes = width * torch.tensor([0.5, 1.0, 1.0, 1.5])
    allowed = region.allows(box, CAMERA, pixels, sizes, torch.zeros(4, 4))
    assert allowed.tolist() == [False, False, True, False]
    closer = region.allows(box, CAMERA, pixels, sizes, torch.zeros(4, 4), same_instance=0.2)
    assert closer.tolist() == [False, True, True, True]


def test_no_distance_is_so_far_that_nothing_is_seen(box: Mesh) -> None:
    far, nearest = SearchRegion(distance=(0.5, 40.0)), box.sphere_diameter * EDGE / 0.5
    assert far.widths(box, CAMERA, SHARES) == pytest.approx((16.0, 500 * nearest))
    large = CAMERA.resize(2560, 1920)  # there the same part of the image has more pixels
    assert far.widths(box, large, SHARES) == pytest.approx((32.0, 2000 * nearest), rel=1e-3)
    words = "even at 10 m the object would be under 16 pixels wide in an image of 640×480"
    with pytest.raises(InputError, match=words):
        SearchRegion(distance=(10.0, 40.0)).widths(box, CAMERA, SHARES)
    # Without a distance small images are searched for objects as small as ever.
    assert SearchRegion().widths(box, CAMERA.resize(160, 120), SHARES)[0] == pytest.approx(12.0)


def ball() -> Mesh:
    sphere = trimesh.creation.icosphere(3, 0.05)
    return Mesh.from_arrays("ball", sphere.vertices, sphere.faces)


def aside(degrees: float, distance: float = 0.6) -> Pose:
    angle = np.radians(degrees)
    return at(ball(), distance * np.sin(angle), 0.0, distance * np.cos(angle))


def candidate(pose: Pose, mesh: Mesh) -> tuple[Any, Any, Any, tuple[float, float, float, float]]:
    """Pixel, width on the axis and template box of a ball at a pose, and the box around it."""
    pixel = WIDE.project(mesh.inner(pose).translation)[None].float()
    width = WIDE.fx * mesh.sphere_diameter / float(mesh.inner(pose).translation.norm())
    left, top, right, bottom = seen_box(mesh.inner(pose), mesh, WIDE)
    silhouette = torch.tensor([[-0.5, -0.5, 0.5, 0.5]])
    return pixel, torch.tensor([width]), silhouette, (left, top, right - left, bottom - top)


@pytest.mark.parametrize("degrees", [0, 20, 40, 50, -50])
def test_far_from_the_axis_the_right_pose_agrees_with_its_box(degrees: float) -> None:
    mesh = ball()
    pixel, width, silhouette, seen = candidate(aside(degrees), mesh)
    region = SearchRegion(box=seen)
    assert region.allows(mesh, WIDE, pixel, width, silhouette).all()
    for other in (0.5 * width, 2 * width):
        assert not region.allows(mesh, WIDE, pixel, other, silhouette).any()
    for shifted in (-0.6, 0.6):
        moved = pixel + torch.tensor([[shifted * seen[2], 0.0]])
        assert not region.allows(mesh, WIDE, moved, width, silhouette).any()


@pytest.mark.parametrize("degrees", [0, 20, 40, 50])
def test_far_from_the_axis_things_are_looked_for_as_wide_as_they_are_seen(degrees: float) -> None:
    mesh, pose = ball(), aside(degrees)
    pixel, width, _, box = candidate(pose, mesh)
    seen = (box[2] * box[3]) ** 0.5
    assert float(width * widening(pixel, WIDE)) == pytest.approx(seen, rel=0.06)
    low, high = SearchRegion(near=pose).widths(mesh, WIDE, (0.001, 1.0))
    assert (low * high) ** 0.5 == pytest.approx(seen, rel=0.06)
    for region in (SearchRegion(box=box), SearchRegion(near=pose), SearchRegion()):
        low, high = replace(region, distance=(0.58, 0.62)).widths(mesh, WIDE, SHARES)
        assert 0.9 * low < seen < 1.1 * high


@pytest.mark.parametrize("degrees", [0, 50])
def test_far_from_the_axis_as_many_widths_aside_are_as_far(degrees: float) -> None:
    mesh, pose = ball(), aside(degrees)
    width = candidate(pose, mesh)[1].expand(4)
    turns = np.degrees(np.arctan(np.array([-0.8, -0.7, 0.3, 0.7]) * float(width[0]) / WIDE.fx))
    pixels = torch.cat([candidate(aside(degrees + turn), mesh)[0] for turn in turns])
    allowed = SearchRegion(near=pose).allows(mesh, WIDE, pixels, width, torch.zeros(4, 4))
    assert allowed.tolist() == [False, True, True, True], "0.75 widths aside at most"
    free = SearchRegion(taken=(pose,)).allows(mesh, WIDE, pixels, width, torch.zeros(4, 4))
    assert free.tolist() == [True, True, False, True], "0.4 widths aside at least"
    left, _, right, _ = SearchRegion(near=pose).window(mesh, WIDE, 0.6 * float(width[0])) or [0] * 4
    assert left < float(pixels[1, 0]) and min(float(pixels[3, 0]), 1279) < right


FISHEYE = Camera(400, 400, 319.5, 239.5, 640, 480, (0.0, 0.0, 0.0, 0.0), "fisheye")


def test_a_box_at_the_border_of_a_wide_lens_is_where_its_object_is_without_the_lens() -> None:
    mesh, pose = ball(), aside(40.3)
    left, top, right, bottom = seen_box(mesh.inner(pose), mesh, FISHEYE)
    assert right < 640 < FISHEYE.pinhole.project(mesh.inner(pose).translation)[0]
    around = (left, top, right - left, bottom - top)
    mask = np.zeros((480, 640), bool)
    mask[round(top) : round(bottom) + 1, round(left) : round(right) + 1] = True
    left, top, right, bottom = seen_box(mesh.inner(pose), mesh, FISHEYE.full_pinhole)
    for known in ({"box": around}, {"mask": mask}):
        region = SearchRegion.checked(FISHEYE, **known).undistorted(FISHEYE)
        # Pixels: the lens bends the box's sides outwards.
        expected = pytest.approx((left, top, right - left, bottom - top), abs=7)
        assert region.bounds == expected
