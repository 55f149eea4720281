"""Cameras as others write them, made here by OpenCV or typed from their documentation."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from tests.support.camera_files import LENS, WANTED, K, saved

FLAT = "[600.0, 0.0, 320.0, 0.0, 610.0, 240.0, 0.0, 0.0, 1.0]"

ROS_FILE = """\
image_width: 640
image_height: 480
camera_name: head_camera
camera_matrix:
  rows: 3
  cols: 3
  data: [600., 0., 320., 0., 610., 240., 0., 0., 1.]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.3, 0.1, 0.001, 0.002, 0.01]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [580, 0, 321, 0, 0, 590, 241, 0, 0, 0, 1, 0]
"""
ROS_ECHO = f"""\
header:
  stamp: {{sec: 1, nanosec: 5}}
  frame_id: camera
height: 480
width: 640
distortion_model: plumb_bob
d: [-0.3, 0.1, 0.001, 0.002, 0.01]
k: {FLAT}
r: [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
p: [580.0, 0.0, 321.0, 0.0, 0.0, 590.0, 241.0, 0.0, 0.0, 0.0, 1.0, 0.0]
binning_x: 0
binning_y: 0
roi: {{x_offset: 0, y_offset: 0, height: 0, width: 0, do_rectify: false}}
---
header: {{}}
"""


@pytest.mark.parametrize("name", ["camera.yml", "camera.xml", "camera.json"])
@pytest.mark.parametrize("fisheye", [False, True])
def test_what_opencv_writes(tmp_path: Path, name: str, fisheye: bool) -> None:
    lens = np.array([[0.01, -0.02, 0.03, 0.004]]).T if fisheye else np.array([LENS])
    store = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
    store.write("calibration_time", "Sat 28 Nov 2026")
    store.write("nframes", 25)  # of the sample calibration.cpp; the tutorial says nr_of_frames
    store.write("image_width", 640)
    store.write("image_height", 480)
    store.write("flags", 0)
    if fisheye:
        store.write("fisheye_model", 1)
    store.write("camera_matrix", np.array(K))
    store.write("distortion_coefficients", lens)
    store.write("avg_reprojection_error", 0.21)
    store.release()
    found = Camera.load(tmp_path / name)
    if fisheye:
        assert found.distortion_model == "fisheye" and found.distortion == tuple(lens[:, 0])
    else:
        assert found == WANTED


@pytest.mark.parametrize("name", ["camera.yml", "camera.xml", "camera.json"])
@pytest.mark.parametrize("keys", [("camera_matrix", "dist_coeffs"), ("cameraMatrix", "distCoeffs")])
def test_what_opencvs_interactive_calibration_writes(
    tmp_path: Path, name: str, keys: tuple[str, str]
) -> None:
    store = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
    store.write("calibrationDate", "Sat 28 Nov 2026")
    store.write("framesCount", 25)
    store.write("cameraResolution", np.array([640, 480]))  # of one dimension: a tag of its own
    for key, values in zip(keys, (np.array(K), np.array(LENS)), strict=True):
        store.write(key, values)
        store.write(f"{key}_std_dev", np.ones((5, 1)))
    store.write("avg_reprojection_error", 0.21)
    store.release()
    assert Camera.load(tmp_path / name) == WANTED


def test_numbers_of_yaml_are_those_of_its_version_1_2(tmp_path: Path) -> None:
    content = (
        "fx: 6e2\nfy: +610.\ncx: 320\ncy: 240\nwidth: 0640\nheight: 480\nD: [1e-05, -.2, 0, 0]"
    )
    found = Camera.load(saved(tmp_path, "camera.yaml", content))
    assert (found.fx, found.fy, found.width) == (600.0, 610.0, 640)
    assert found.distortion == (1e-05, -0.2, 0.0, 0.0)


@pytest.mark.parametrize("content", [ROS_FILE, ROS_ECHO], ids=["file", "echo"])
def test_what_ros_writes(tmp_path: Path, content: str) -> None:
    assert Camera.load(saved(tmp_path, "camera.yaml", content)) == WANTED


def test_files_that_are_none(tmp_path: Path) -> None:
    (tmp_path / "bytes.yaml").write_bytes(b"\xff\xfe\x00\x01")
    (tmp_path / "large.json").write_bytes(b" " * 5_000_000)
    saved(tmp_path, "deep.json", "[" * 100_000)
    for name in ("bytes.yaml", "large.json", "deep.json", "missing.yaml", "."):
        with pytest.raises(InputError):
            Camera.load(tmp_path / name)


@pytest.mark.parametrize(
    "kind", [list, np.array, lambda v: np.array(v, np.float32), lambda v: torch.tensor(v)]
)
def test_from_matrix_takes_what_calibrations_give(kind: Any) -> None:
    for lens in (LENS, [LENS], [[value] for value in LENS]):
        found = Camera.from_matrix(kind(K), 640, np.int64(480), kind(lens))
        assert found.distortion == pytest.approx(LENS) and (found.fx, found.cy) == (600, 240)
        hash(found)
    assert Camera.from_matrix(kind(K), 640, 480, []).distortion is None
    with pytest.raises(InputError, match="3×3"):
        Camera.from_matrix([1, 2], 640, 480)
    with pytest.raises(InputError, match="has the rows"):
        Camera.from_matrix(np.array(K).T, 640, 480)


def test_from_fov_goes_by_the_longer_side() -> None:
    landscape, portrait = Camera.from_fov(60, 1920, 1080), Camera.from_fov(60, 1080, 1920)
    assert landscape.fx == portrait.fx == landscape.fy
    assert 2 * np.degrees(np.arctan(960 / landscape.fx)) == pytest.approx(60)
    assert landscape.cx == 959.5
    with pytest.raises(InputError, match="1 to 170"):
        Camera.from_fov(180, 640, 480)
