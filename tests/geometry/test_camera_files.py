"""Cameras as others write them, made here by OpenCV or typed from their documentation."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera

WANTED = Camera(600, 610, 320, 240, 640, 480, (-0.3, 0.1, 0.001, 0.002, 0.01))
K = [[600.0, 0.0, 320.0], [0.0, 610.0, 240.0], [0.0, 0.0, 1.0]]
FLAT = "[600.0, 0.0, 320.0, 0.0, 610.0, 240.0, 0.0, 0.0, 1.0]"
FOCAL: dict[str, Any] = {"fx": 600, "fy": 610, "cx": 320, "cy": 240}
SIZE: dict[str, Any] = {"width": 640, "height": 480}
LENS = [-0.3, 0.1, 0.001, 0.002, 0.01]

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
KALIBR = """\
cam0:
  cam_overlaps: []
  camera_model: pinhole
  distortion_coeffs: [-0.01, 0.02, -0.003, 0.001]
  distortion_model: equidistant
  intrinsics: [461.6, 460.3, 362.6, 248.1]
  resolution: [752, 480]
  rostopic: /cam0/image_raw
"""
M3T = "%YAML:1.2\nintrinsics:\n  f_u: 600\n  f_v: 610\n  pp_x: 320\n  pp_y: 240\n  width: 640\n"


def saved(folder: Path, name: str, content: Any) -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


@pytest.mark.parametrize("name", ["camera.yml", "camera.xml", "camera.json"])
@pytest.mark.parametrize("fisheye", [False, True])
def test_what_opencv_writes(tmp_path: Path, name: str, fisheye: bool) -> None:
    lens = np.array([[0.01, -0.02, 0.03, 0.004]]).T if fisheye else np.array([LENS])
    store = cv2.FileStorage(str(tmp_path / name), cv2.FILE_STORAGE_WRITE)
    store.write("calibration_time", "Sat 28 Nov 2026")
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


@pytest.mark.parametrize("content", [ROS_FILE, ROS_ECHO], ids=["file", "echo"])
def test_what_ros_writes(tmp_path: Path, content: str) -> None:
    assert Camera.load(saved(tmp_path, "camera.yaml", content)) == WANTED


def test_kalibr_and_m3t(tmp_path: Path) -> None:
    found = Camera.load(saved(tmp_path, "camchain.yaml", KALIBR))
    assert found == Camera(
        461.6, 460.3, 362.6, 248.1, 752, 480, (-0.01, 0.02, -0.003, 0.001), "fisheye"
    )
    two = KALIBR + KALIBR.replace("cam0", "cam1")
    with pytest.raises(InputError, match=r"2 cameras \(cam0, cam1\)"):
        Camera.load(saved(tmp_path, "two.yaml", two))
    m3t = Camera.load(saved(tmp_path, "m3t.yaml", M3T + "  height: 480\n"))
    assert m3t == WANTED.pinhole
    with pytest.raises(InputError, match="height missing"):
        Camera.load(saved(tmp_path, "m3t.yaml", M3T))


@pytest.mark.parametrize(
    "content",
    [
        {**FOCAL, **SIZE, "dist_coeffs": LENS},
        {**FOCAL, **SIZE, "D": [LENS], "distortion_model": "plumb_bob"},
        {**FOCAL, **SIZE, "distCoeffs": LENS},
        {**FOCAL, **SIZE, **dict(zip(("k1", "k2", "p1", "p2", "k3"), LENS, strict=True))},
        {"K": K, "image_size": [640, 480], "distortion_coefficients": {"data": LENS}},
        {"camera_matrix": K, **SIZE, "fx": 600, "distortion": LENS, "distortion_model": "radtan"},
        {"camera": {**FOCAL, **SIZE, "distortion": LENS}, "version": 2},
        {
            "width": 640, "height": 480, "ppx": 320.0, "ppy": 240.0, "fx": 600.0, "fy": 610.0,
            "model": "distortion.brown_conrady", "coeffs": LENS,
        },
    ],
)  # fmt: skip
def test_the_names_that_people_use(tmp_path: Path, content: dict[str, Any]) -> None:
    assert Camera.load(saved(tmp_path, "camera.json", content)) == WANTED


def test_realsense_and_open3d(tmp_path: Path) -> None:
    content = {**FOCAL, **SIZE, "model": "Inverse Brown Conrady", "coeffs": [0.0] * 5}
    assert Camera.load(saved(tmp_path, "a.json", content)) == WANTED.pinhole
    content["coeffs"] = [0.1, 0.0, 0.0, 0.0, 0.0]
    with pytest.raises(InputError, match="inverse_brown_conrady"):
        Camera.load(saved(tmp_path, "b.json", content))
    content["model"] = "Kannala Brandt4"
    assert Camera.load(saved(tmp_path, "c.json", content)).distortion_model == "fisheye"
    columns = {**SIZE, "intrinsic_matrix": np.array(K).T.reshape(9).tolist()}
    assert Camera.load(saved(tmp_path, "d.json", columns)) == WANTED.pinhole


def test_skew_is_read(tmp_path: Path) -> None:
    content = {**FOCAL, **SIZE, "skew": 3.5}
    assert Camera.load(saved(tmp_path, "a.json", content)).skew == 3.5
    sheared = [[600, 3.5, 320], [0, 610, 240], [0, 0, 1]]
    assert Camera.load(saved(tmp_path, "b.json", {"K": sheared, **SIZE})).skew == 3.5


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({**FOCAL, **SIZE, "distorsion": LENS}, "'distorsion'; did you mean 'distortion'"),
        ({**FOCAL, **SIZE, "dist_coef": LENS}, "did you mean 'dist_coef"),
        ({**FOCAL, **SIZE, "gamma": 2.2}, "unknown key 'gamma'; a camera has fx"),
        ({**FOCAL, **SIZE, "distortion": LENS, "distortion_model": "equidistant"}, "4 coefficien"),
        ({**FOCAL, **SIZE, "distortion": LENS, "distortion_model": "ftheta"}, "'ftheta'"),
        ({**FOCAL, **SIZE, "distortion": LENS[:3]}, "4, 5, 8, 12 or 14"),
        ({**FOCAL, **SIZE, "distortion": LENS, "k1": 0.1}, "k1 and distortion"),
        ({**FOCAL, **SIZE, "k1": 0.1, "k2": 0, "k3": 0, "k4": 0}, "add distortion_model"),
        ({**FOCAL, **SIZE, "K": [[700, 0, 320], *K[1:]]}, "fx is 600, but 700"),
        ({**FOCAL, **SIZE, "image_width": 1280}, "says again"),
        ({**FOCAL, **SIZE, "resolution": [1280, 480]}, "width is 640 .* 1280"),
        ({**FOCAL, **SIZE, "binning_x": 2}, "binning_x is 2"),
        ({**FOCAL, **SIZE, "roi": {"x_offset": 4}}, "roi is"),
        ({**FOCAL, **SIZE, "camera_model": "omni"}, "'omni'"),
        ({"K": [1, 2, 3], **SIZE}, "9 numbers"),
        ({"K": [[600, 0, 320], [5, 610, 240], [0, 0, 1]], **SIZE}, "has the rows"),
        ({"K": {"rows": 3, "cols": 2, "data": [1] * 9}, **SIZE}, "3 × 2"),
        ({**FOCAL, "width": 10**400, "height": 480}, "finite"),
        ({**FOCAL, "width": 10**7, "height": 480}, "not an image size"),
        ("a: &a [1]\nb: *a\n", "no aliases"),
        ("fx: [\n", "not a YAML file"),
        ("- 1\n", "holds no camera"),
        ("", "holds no camera"),
        ("<opencv_storage><a>", "not an XML file"),
        ("<!DOCTYPE x []><opencv_storage/>", "DOCTYPE"),
        ("<camera/>", "opencv_storage"),
    ],
)
def test_what_cannot_be_a_camera_is_named_in_one_sentence(
    tmp_path: Path, content: Any, words: str
) -> None:
    path = saved(tmp_path, "camera.txt", content)
    with pytest.raises(InputError, match=words) as caught:
        Camera.load(path)
    message = str(caught.value)
    assert message.startswith(str(path)) and len(message) < 600 and "\n" not in message


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
