"""Boards drawn through known lenses by OpenCV: the camera comes back, by both kinds of board."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from moveit6d.camera_calibration import Board, Calibration, Corners, calibrate, choose_views
from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from tests.support.board_photos import FISHEYE, HEIGHT, STANDARD, WIDTH, photos


@pytest.mark.parametrize(
    ("board", "camera", "lens"),
    [
        (Board("charuco", 5, 7), STANDARD, "standard"),
        (Board("charuco", 5, 7), FISHEYE, "fisheye"),
        (Board("chessboard", 6, 7), STANDARD, "standard"),
    ],
    ids=["charuco", "fisheye", "chessboard"],
)
def test_the_camera_that_took_the_photos_comes_back(
    board: Board, camera: Camera, lens: Any
) -> None:
    found = [board.find(image) for image in photos(board, camera, 10)]
    views = [view for view in found if view is not None]
    assert len(views) >= 7
    result = calibrate(views, WIDTH, HEIGHT, lens)
    assert result.error < 0.25 and result.camera.distortion_model == camera.distortion_model
    assert result.camera.fx == pytest.approx(camera.fx, rel=0.01)
    assert result.camera.cy == pytest.approx(camera.cy, abs=4)
    # What counts is how points lie to each other: a shift of all is a turn of the camera.
    x, y = np.meshgrid(np.linspace(-0.4, 0.4, 9), np.linspace(-0.3, 0.3, 7))
    points = np.column_stack([x.ravel(), y.ravel(), np.ones(x.size)])
    assert camera.lens is not None and result.camera.lens is not None
    expected = camera.lens.project(points, camera.matrix.numpy())
    landed = result.camera.lens.project(points, result.camera.matrix.numpy())
    apart = expected - landed - (expected - landed).mean(0)
    assert np.sqrt((apart**2).sum(1).mean()) < 1.3


WIDE = 600 / np.pi  # of an equidistant lens that shows 180 degrees across 600 pixels


@pytest.mark.parametrize(
    ("camera", "degrees"),
    [
        (Camera(320, 300, 319.5, 239.5, 640, 480), 90),
        (Camera(100, 320, 239.5, 319.5, 480, 640), 90),
        (Camera(320, 320, -0.5, 239.5, 640, 480), np.degrees(np.arctan(2))),
        (Camera(WIDE, WIDE, 299.5, 199.5, 600, 400, (0, 0, 0, 0), "fisheye"), 180),
        (Camera(99, WIDE, 199.5, 299.5, 400, 600, (0, 0, 0, 0), "fisheye"), 180),
        (Camera(0.9 * WIDE, 99, 299.5, 199.5, 600, 400, (0, 0, 0, 0), "fisheye"), 200),
    ],
    ids=["wide", "upright", "off the middle", "fisheye", "upright fisheye", "beyond 180"],
)
def test_the_field_of_view_is_that_of_the_lens(camera: Camera, degrees: float) -> None:
    assert Calibration(camera, 0.1, 9, 1.0).field_of_view == pytest.approx(degrees, abs=0.01)


@pytest.mark.parametrize("camera", [STANDARD, FISHEYE], ids=["standard", "fisheye"])
def test_the_field_of_view_is_where_opencv_sees_the_edges(camera: Camera) -> None:
    edges = np.array([[[-0.5, (HEIGHT - 1) / 2]], [[WIDTH - 0.5, (HEIGHT - 1) / 2]]])
    module = cv2.fisheye if camera.distortion_model == "fisheye" else cv2
    plane = module.undistortPoints(edges, camera.matrix.numpy(), np.array(camera.distortion))
    one, two = np.column_stack([plane.reshape(2, 2), np.ones(2)])
    expected = np.degrees(np.arccos(one @ two / np.linalg.norm(one) / np.linalg.norm(two)))
    found = Calibration(camera, 0.1, 9, 1.0).field_of_view
    assert found == pytest.approx(expected, abs=0.02)


def synthetic_views(
    count: int, noise: float = 0.05, bad: int = 0, spoilt: float = 8.0
) -> list[Corners]:
    """Corners of a 6 × 8 board by projection alone, some views of them spoilt."""
    random = np.random.default_rng(1)
    y, x = np.divmod(np.arange(48), 6)
    places = np.column_stack([x, y, np.zeros(48)]).astype(np.float32)
    views = []
    for number in range(count):
        turn = Rotation.from_euler("xyz", [*random.uniform(-40, 40, 2), 5], degrees=True)
        depth = random.uniform(10, 14)
        centre = np.array([*random.uniform(-0.3, 0.3, 2) * depth, depth])
        points = (places - (2.5, 3.5, 0)) @ turn.as_matrix().T + centre
        assert STANDARD.lens is not None
        pixels = STANDARD.lens.project(points, STANDARD.matrix.numpy())
        scale = spoilt if number < bad else noise
        views.append(
            Corners((pixels + random.normal(0, scale, pixels.shape)).astype(np.float32), places)
        )
    return views


def test_spoilt_views_are_left_out() -> None:
    result = calibrate(synthetic_views(14, bad=2), WIDTH, HEIGHT)
    assert result.views == 12 and result.error < 0.15
    assert result.camera.fx == pytest.approx(STANDARD.fx, rel=0.01) and result.doubts() == []


def test_spoilt_views_are_left_out_before_the_lens_is_judged() -> None:
    result = calibrate(synthetic_views(12, bad=2, spoilt=25.0), WIDTH, HEIGHT, "rational")
    assert result.views <= 10 and result.error < 0.15
    assert result.camera.fx == pytest.approx(STANDARD.fx, rel=0.01)


def test_a_lens_that_folds_says_which_pictures_are_missing() -> None:
    words = "rational lens that fits.* in the corners, or take --lens standard"
    with pytest.raises(InputError, match=words):
        calibrate(synthetic_views(7, noise=3.0), WIDTH, HEIGHT, "rational")


def test_few_or_like_views_are_doubted() -> None:
    with pytest.raises(
        InputError, match=r"found in 5 pictures.*--squares and, of a charuco board, --dictionary"
    ):
        calibrate(synthetic_views(5), WIDTH, HEIGHT)
    (view,) = synthetic_views(1)
    try:
        alike = calibrate([view] * 8, WIDTH, HEIGHT)
    except InputError as error:
        assert "several distances" in str(error)
    else:
        assert any("edges" in doubt for doubt in alike.doubts())


def test_views_are_chosen_to_differ() -> None:
    views = synthetic_views(10)
    same = [views[0]] * 20
    chosen = choose_views(views + same, WIDTH, HEIGHT, 10)
    assert len(chosen) == 10 and len([number for number in chosen if number < 10]) >= 9
    assert choose_views(views, WIDTH, HEIGHT, 40) == list(range(10))
