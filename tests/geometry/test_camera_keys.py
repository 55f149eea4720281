"""What the keys of camera files mean: names that people use, and what cannot be a camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from tests.support.camera_files import LENS, WANTED, K, saved

FOCAL: dict[str, Any] = {"fx": 600, "fy": 610, "cx": 320, "cy": 240}


SIZE: dict[str, Any] = {"width": 640, "height": 480}


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


LAVAL = {"focalX": 600, "focalY": 610, "centerX": 320, "centerY": 240, **SIZE}


def test_laval(tmp_path: Path) -> None:
    wanted = Camera(600, 610, 320, 240, 640, 480)
    assert Camera.load(saved(tmp_path, "camera.json", LAVAL)) == wanted
    british = {**FOCAL, **SIZE, "centre_x": 320, "centre_y": 240}
    del british["cx"], british["cy"]
    assert Camera.load(saved(tmp_path, "camera.json", british)) == wanted
    lens = {**LAVAL, "distortion": [list(LENS)]}
    assert Camera.load(saved(tmp_path, "camera.json", lens)).distortion == tuple(LENS)


def test_a_height_that_comes_first_is_named(tmp_path: Path) -> None:
    """MegaPose's camera_data.json."""
    megapose = {"K": [[605.9, 0, 319.0], [0, 605.0, 249.7], [0, 0, 1]], "resolution": [480, 640]}
    with pytest.raises(InputError, match='MegaPose\'s files, give "width": 640, "height": 480'):
        Camera.load(saved(tmp_path, "camera_data.json", megapose))
    for size in ([640, 480], [480, 480]):
        found = Camera.load(saved(tmp_path, "camera.json", {**megapose, "resolution": size}))
        assert [found.width, found.height] == size
    upright = {"K": [[600, 0, 240], [0, 600, 320], [0, 0, 1]], "resolution": [480, 640]}
    assert Camera.load(saved(tmp_path, "camera.json", upright)).height == 640


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
        {"7": {"cam_K": K, **SIZE, "D": LENS, "cam_R_w2c": [0] * 9, "cam_t_w2c": [0] * 3}},
        {"camera": {"cam_K": K, "image_size": [640, 480], "D": LENS}},
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
        ({**FOCAL, **SIZE, "k1": -0.9}, "fold the picture 245 pixels"),
        ({"K": [[600, 0, 320], [5, 610, 240], [0, 0, 1]], **SIZE}, "has the rows"),
        ({"K": {"rows": 3, "cols": 2, "data": [1] * 9}, **SIZE}, "3 × 2"),
        ({"K": K, **SIZE, "D": {"sizes": [5], "data": [0.1] * 4}}, "4 numbers, its size says 5"),
        ({**FOCAL, "width": 10**400, "height": 480}, "finite"),
        ({**FOCAL, "width": 10**7, "height": 480}, "not an image size"),
        ({str(i): {"cam_K": [1] * 9, "depth_scale": 1} for i in range(1200)}, "scene_camera.json"),
        ({"3": {"cam_K": [1] * 9, "cam_R_w2c": [1] * 9}}, "give the data set's camera.json"),
        ({f"cam{i}": {**FOCAL, **SIZE} for i in range(99)}, r"99 cameras \(.*cam3, cam4, …\)"),
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
