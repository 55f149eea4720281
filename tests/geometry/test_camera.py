"""The camera against OpenCV, and the half-pixel rule."""

from collections.abc import Callable
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera, project

CAMERA = Camera(572.4, 573.6, 325.3, 242.0, 640, 480)


def points(count: int = 50) -> torch.Tensor:
    generator = torch.Generator().manual_seed(0)
    place = torch.randn(count, 3, dtype=torch.float64, generator=generator) * 0.2
    return place + torch.tensor([0.0, 0, 1])


def test_projection_agrees_with_opencv() -> None:
    expected, _ = cv2.projectPoints(
        points().numpy(), np.zeros(3), np.zeros(3), CAMERA.matrix.numpy(), np.zeros(5)
    )
    assert np.abs(CAMERA.project(points()).numpy() - expected[:, 0]).max() < 1e-9


def test_crop_moves_the_pixel_of_a_point_by_the_window_corner() -> None:
    moved = CAMERA.crop(100, 40, 64, 64).project(points()) - CAMERA.project(points())
    assert torch.allclose(moved, torch.tensor([-100.0, -40.0], dtype=torch.float64))


@pytest.mark.parametrize(("width", "height"), [(320, 240), (1280, 960), (100, 333)])
def test_resize_keeps_what_pixels_cover(width: int, height: int) -> None:
    """Pixel (0, 0) is a pixel's centre: an image reaches from −0.5 to width − 0.5."""
    before, after = CAMERA.project(points()), CAMERA.resize(width, height).project(points())
    share = (before + 0.5) / torch.tensor([640.0, 480.0])
    assert torch.allclose((after + 0.5) / torch.tensor([width, height]), share, atol=1e-12)


def test_resize_agrees_with_resampling_an_image() -> None:
    """The centre of a blob stays the projection of its point when OpenCV halves the image."""
    camera = Camera(500, 500, 319.5, 239.5, 640, 480)
    point = torch.tensor([0.0213, -0.0378, 1.0], dtype=torch.float64)
    u, v = camera.project(point).tolist()
    x, y = np.meshgrid(np.arange(640), np.arange(480))
    image = np.exp(-((x - u) ** 2 + (y - v) ** 2) / 50).astype(np.float32)
    small = cv2.resize(image, (320, 240), interpolation=cv2.INTER_AREA)
    x, y = np.meshgrid(np.arange(320), np.arange(240))
    found = [(small * x).sum() / small.sum(), (small * y).sum() / small.sum()]
    assert np.allclose(found, camera.resize(320, 240).project(point).tolist(), atol=0.01)


def test_undistortion_agrees_with_opencv() -> None:
    lens = (0.12, -0.2, 0.001, -0.002, 0.05)
    camera = Camera(400, 410, 160, 118, 320, 240, lens)
    random = np.random.default_rng(0)
    image = cv2.GaussianBlur(random.integers(0, 255, (240, 320, 3), dtype=np.uint8), (0, 0), 3)
    expected = cv2.undistort(image, camera.matrix.numpy(), np.array(lens))
    undone, pinhole = camera.undistort(torch.from_numpy(image).permute(2, 0, 1))
    assert pinhole.distortion is None
    difference = undone.permute(1, 2, 0).numpy().astype(int) - expected
    assert np.abs(difference[20:-20, 20:-20]).max() <= 2


def test_without_distortion_the_image_is_untouched() -> None:
    image = torch.zeros(3, 480, 640)
    assert CAMERA.undistort(image)[0] is image


@pytest.mark.parametrize(
    "values", [(0, 1, 0, 0, 4, 4), (1, float("nan"), 0, 0, 4, 4), (1, 1, 0, 0, 0, 4)]
)
def test_impossible_cameras_are_refused(values: tuple[float, ...]) -> None:
    with pytest.raises(InputError, match="Camera"):
        Camera(*values)  # type: ignore[arg-type]


@settings(deadline=None)
@given(st.integers(0, 10_000))
def test_projection_is_kornias_and_its_fast_twin_agrees(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = torch.from_numpy(random.uniform([-1, -1, 0.1], [1, 1, 5], (2, 7, 3)))
    pixels = CAMERA.project(points)
    torch.testing.assert_close(pixels, project(points, CAMERA.matrix), rtol=1e-12, atol=1e-9)
    torch.testing.assert_close(CAMERA.unproject(pixels, points[..., 2]), points)
    assert torch.equal(CAMERA.project(points[0, 0]), pixels[0, 0])
    expected, _ = cv2.projectPoints(
        points.reshape(-1, 3).numpy(), np.zeros(3), np.zeros(3), CAMERA.matrix.numpy(), None
    )
    np.testing.assert_allclose(pixels.reshape(-1, 2).numpy(), expected[:, 0], atol=1e-6)


def test_a_point_on_the_camera_s_plane_has_no_pixel() -> None:
    assert CAMERA.project(torch.tensor([[0.1, 0.0, 0.0]])).isnan().all()


def test_whole_numbers_are_those_of_floats() -> None:
    pixels, places = torch.tensor([[440, 240], [3, 7]]), torch.tensor([[1, -2, 3], [0, 1, 7]])
    torch.testing.assert_close(
        CAMERA.unproject(pixels, 0.5), CAMERA.unproject(pixels.double(), 0.5)
    )
    torch.testing.assert_close(CAMERA.project(places), CAMERA.project(places.double()))


def test_gradients_flow_through_projection() -> None:
    points = torch.tensor([[0.1, -0.2, 0.7]], dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(CAMERA.project, points)


LENS = Camera(60, 61, 31, 23, 64, 48, [-0.1, 0.01, 0, 0])


def test_points_and_pixels_may_be_arrays_and_lists() -> None:
    for points in ([[0.1, 0.0, 0.5]], np.array([[0.1, 0, 0.5]], np.float32)):
        expected = LENS.project(torch.tensor([[0.1, 0.0, 0.5]], dtype=torch.float64))
        torch.testing.assert_close(LENS.project(points), expected, rtol=1e-6, atol=1e-5)
    pixels, depth = [[40, 10], [3, 4]], np.array([0.5, 0.6])
    expected = LENS.pinhole.unproject(torch.tensor(pixels), torch.from_numpy(depth))
    torch.testing.assert_close(LENS.pinhole.unproject(np.array(pixels), depth), expected)
    torch.testing.assert_close(LENS.pinhole.unproject(pixels, [0.5, 0.6]), expected)


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: LENS.project([[0.0, 1.0]]), r"points must be \(\.\.\., 3\), found shape \(1, 2\)"),
        (lambda: LENS.project("points"), "points must be numbers"),
        (lambda: LENS.project([[0.0, 1.0, 2.0], [1.0]]), "points must be numbers"),
        (lambda: LENS.pinhole.unproject([1.0]), r"pixels must be \(\.\.\., 2\)"),
        (lambda: LENS.pinhole.unproject([[1, 2]], [1.0, 2.0]), "do not fit to pixels"),
        (lambda: LENS.pinhole.unproject([[1, 2]], "far"), "depth must be numbers"),
        (lambda: Camera.from_fov("wide", 640, 480), "field of view must be numbers"),
    ],
)
def test_what_are_no_points_is_said(call: Callable[[], object], words: str) -> None:
    with pytest.raises(InputError, match=words):
        call()


def test_images_of_every_layout_are_undistorted() -> None:
    image = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    expected = LENS.undistort(torch.from_numpy(image).permute(2, 0, 1))[0].permute(1, 2, 0).numpy()
    assert np.abs(expected.astype(int) - image).max() > 50
    for one in (image, torch.from_numpy(image), np.asfortranarray(image)):
        found, pinhole = LENS.undistort(one)
        assert type(found) is type(one) and found.dtype == one.dtype and pinhole.lens is None
        np.testing.assert_array_equal(np.asarray(found), expected)
    np.testing.assert_array_equal(LENS.undistort(image[..., 1])[0], expected[..., 1])
    np.testing.assert_array_equal(LENS.undistort(image[..., :1])[0], expected[..., :1])
    batch = np.moveaxis(image, -1, 0)[None, None].repeat(2, 0)
    np.testing.assert_array_equal(LENS.undistort(batch)[0][1, 0], np.moveaxis(expected, -1, 0))
    assert LENS.undistort(batch[:0])[0].shape == (0, 1, 3, 48, 64)


def test_the_full_image_without_the_lens_holds_the_usual_one() -> None:
    image = np.random.default_rng(0).integers(0, 255, (48, 64, 3), np.uint8)
    barrel = Camera(40, 40, 31.5, 23.5, 64, 48, (-0.2, 0.03, 0.0, 0.0))
    usual, found = barrel.undistort(image)[0], barrel.full_pinhole
    left, top = round(found.cx - barrel.cx), round(found.cy - barrel.cy)
    assert left > 2 and top > 2 and found.fx == 40 and found.lens is None
    whole = np.moveaxis(image, -1, 0)[None].repeat(2, 0)
    for one, shape in (
        (image, (found.height, found.width, 3)),
        (image[..., 0], (found.height, found.width)),
        (torch.from_numpy(whole), (2, 3, found.height, found.width)),
    ):
        full, camera = barrel.undistort(one, full=True)
        assert type(full) is type(one) and full.shape == shape and camera == found
        flat = np.moveaxis(np.asarray(full)[1], 0, -1) if len(shape) == 4 else np.asarray(full)
        inner = flat[top : top + 48, left : left + 64]
        np.testing.assert_array_equal(inner, usual if len(shape) > 2 else usual[..., 0])
    assert CAMERA.full_pinhole == CAMERA


@pytest.mark.parametrize("camera", [LENS, LENS.pinhole])
@pytest.mark.parametrize(
    ("image", "words"),
    [
        (torch.zeros(3, 24, 32), r"the camera is 64×48, .* found \(3, 24, 32\)"),
        (np.zeros((64, 48, 3), np.uint8), r"found \(64, 48, 3\)"),
        (torch.zeros(1, 48, 64, dtype=torch.bool), "found bool"),
        (np.zeros((48, 64), np.int64), "found int64"),
        ("frame.png", "found str"),
    ],
)
def test_what_is_no_image_of_the_camera_is_said(camera: Camera, image: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        camera.undistort(image)
