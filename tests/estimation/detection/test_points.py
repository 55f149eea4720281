"""Clicked points: the pose that OpenCV's projection made them with comes back."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from moveit6d import Camera, InputError, Mesh
from moveit6d.estimation.detection.points import (
    check_points,
    poses_from_points,
    read_points,
    reprojection_error,
)

CAMERA = Camera(500.0, 510.0, 320.0, 240.0, 640, 480)
CORNERS = np.array(
    [[0, 0, 0], [0.1, 0, 0], [0.1, 0.07, 0], [0, 0.07, 0.02], [0.05, 0.02, 0.06], [0, 0, 0.05]]
)


def clicked(camera: Camera, turn: np.ndarray, place: np.ndarray, corners: np.ndarray) -> np.ndarray:
    lens = np.array(camera.distortion or (0,) * 5, float)
    pixels = cv2.projectPoints(corners, turn, place, camera.matrix.numpy(), lens)[0][:, 0]
    return np.hstack([pixels, corners])


@settings(max_examples=25, deadline=None)
@given(
    st.tuples(*[st.floats(-1.5, 1.5)] * 3),
    st.tuples(st.floats(-0.1, 0.1), st.floats(-0.1, 0.1), st.floats(0.4, 1.5)),
)
def test_the_pose_comes_back(turn: tuple[float, ...], place: tuple[float, ...]) -> None:
    rows = clicked(CAMERA, np.array(turn), np.array(place), CORNERS)
    pose = poses_from_points(rows, CAMERA)[0]
    expected = torch.from_numpy(cv2.Rodrigues(np.array(turn))[0])
    torch.testing.assert_close(pose.rotation, expected, atol=1e-4, rtol=0)
    torch.testing.assert_close(
        pose.translation, torch.tensor(place, dtype=torch.float64), atol=1e-4, rtol=0
    )


def test_pixels_are_those_of_the_distorted_image() -> None:
    camera = Camera(500.0, 500.0, 320.0, 240.0, 640, 480, (-0.3, 0.1, 0.0, 0.0, 0.0))
    turn, place = np.array([0.3, -0.4, 0.1]), np.array([0.1, -0.08, 0.4])
    pose = poses_from_points(clicked(camera, turn, place, CORNERS), camera)[0]
    torch.testing.assert_close(pose.translation, torch.from_numpy(place), atol=1e-4, rtol=0)


@pytest.mark.parametrize("lens", [None, (-0.3, 0.1, 0.0, 0.0, 0.0)])
def test_skew_is_taken_into_account(lens: tuple[float, ...] | None) -> None:
    camera = Camera(500.0, 510.0, 320.0, 240.0, 640, 480, lens, skew=30.0)
    turn, place = np.array([0.3, -0.4, 0.1]), np.array([0.1, -0.08, 0.4])
    rows = clicked(camera, turn, place, CORNERS)  # OpenCV leaves the skew out
    rows[:, 0] += 30.0 * (rows[:, 1] - 240.0) / 510.0
    for known in (rows, rows[[0, 1, 2, 5]]):
        pose = poses_from_points(known, camera)[0]
        torch.testing.assert_close(pose.translation, torch.from_numpy(place), atol=1e-4, rtol=0)
        assert reprojection_error(rows, pose, camera) < 0.01


def test_four_points_in_a_plane_do(tmp_path: Path) -> None:
    flat = CORNERS[:4] * [1, 1, 0]
    turn, place = np.array([0.5, 0.3, 0.1]), np.array([0.02, 0.01, 0.5])
    poses = poses_from_points(clicked(CAMERA, turn, place, flat), CAMERA)
    assert min(float((p.translation - torch.from_numpy(place)).norm()) for p in poses) < 1e-3


def test_a_file_is_read_in_its_unit(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("u,v,x,y,z\n10,20,100,0,50\n11.5,2,0,0,-7\n")
    points = read_points(path, "mm")
    assert points.tolist() == [[10, 20, 0.1, 0, 0.05], [11.5, 2, 0, 0, -0.007]]


def test_a_heading_says_the_order_of_the_columns(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("X, y, z, U, v\n0.1,0,0.05,10,20\n0,0,-0.007,11.5,2\n")
    assert read_points(path, "m").tolist() == [[10, 20, 0.1, 0, 0.05], [11.5, 2, 0, 0, -0.007]]
    path.write_text("a,b,x,y,z\n10,20,0.1,0,0\n")
    with pytest.raises(InputError, match=r"heading is 'a,b,x,y,z'; the columns are u,v,x,y,z"):
        read_points(path, "m")
    path.write_text("0.1,0,0.05,10,20\n0,0,-0.007,11.5,2\n")  # pixels last, and nothing says so
    with pytest.raises(InputError, match=r"within 2\.0 pixels of each other"):
        read_points(path, "m")


def test_what_cannot_be_right_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "points.csv"
    path.write_text("10,20,1,2\n")
    with pytest.raises(InputError, match="line 1: five numbers"):
        read_points(path, "m")
    with pytest.raises(InputError, match="does not exist"):
        read_points(tmp_path / "none.csv", "m")
    for few in (np.zeros((3, 5)), np.zeros((4, 4)), np.full((4, 5), np.nan)):
        with pytest.raises(InputError, match="at least 4 rows"):
            poses_from_points(few, CAMERA)
    with pytest.raises(InputError, match="must be rows of numbers, found 'points"):
        poses_from_points("points.csv", CAMERA)
    line = np.hstack([np.full((5, 2), 100.0), np.arange(5)[:, None] * [[0.1, 0, 0]]])
    with pytest.raises(InputError, match="no pose in front"):
        poses_from_points(line, CAMERA)


@pytest.mark.parametrize("mark", [";", "\t"])
@pytest.mark.parametrize("heading", ["", "u;v;x;y;z\n", "x;y;z;u;v\n"])
def test_decimal_commas_of_a_table_program(tmp_path: Path, mark: str, heading: str) -> None:
    path = tmp_path / "points.csv"
    rows = ["10,5;20;0,1;0;-0,05", "11;2,25;0;0;7e-3"]
    if heading.startswith("x"):
        rows = [";".join(row.split(";")[k] for k in (2, 3, 4, 0, 1)) for row in rows]
    path.write_text((heading + "\n".join(rows)).replace(";", mark))
    assert read_points(path, "m").tolist() == [[10.5, 20, 0.1, 0, -0.05], [11, 2.25, 0, 0, 0.007]]


def test_points_beside_the_surface_are_warned_of(
    brick: Mesh, caplog: pytest.LogCaptureFixture
) -> None:
    places = np.concatenate([brick.vertices[::9] + brick.center, brick.sample_points(20, seed=5)])
    rows = np.hstack([np.zeros((len(places), 2)), places])
    check_points(rows, brick)
    check_points(rows + [0, 0, 0.03 * brick.diameter, 0, 0], brick)  # as careful as people click
    assert not caplog.records
    rows[7, 4] += 0.2 * brick.diameter
    check_points(rows, brick)
    (record,) = caplog.records
    assert record.levelname == "WARNING"
    said = record.getMessage()
    assert "number 8 (" in said and "moveit6d doctor --mesh" in said
    caplog.clear()
    from_a_corner = rows - [0, 0, *(brick.vertices.min(0) + brick.center)]
    check_points(from_a_corner, brick)
    assert len(caplog.records) == 1


def test_points_that_lie_off_the_mesh_are_refused(brick: Mesh) -> None:
    places = brick.vertices[::9].astype(float) + brick.center
    rows = np.hstack([np.zeros((len(places), 2)), places])
    check_points(rows, brick)
    half = rows + np.array([0, 0, brick.diameter / 2, 0, 0])  # a click beside it
    check_points(half, brick)
    with pytest.raises(InputError, match=r"at least 4 rows .*shape \(3, 5\)"):
        check_points(rows[:3], brick)
    for factor in (1000, 100, 10):
        with pytest.raises(InputError, match=r"lie up to .* m from a mesh 0\.\d+ m across"):
            check_points(rows * factor, brick)
    with pytest.raises(InputError, match="span no more than"):
        check_points(rows * [1, 1, 0.001, 0.001, 0.001], brick)
    with pytest.raises(InputError, match="lie up to"):
        check_points(rows + np.array([0, 0, 0, 0, 3 * brick.diameter]), brick)  # another frame
