"""Images as OpenCV, ROS, PIL and torch hand them over become the same frame, or one sentence."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.frame import Frame, prepare_frame
from moveit6d.geometry.camera import Camera

CAMERA = Camera(50, 50, 19.5, 14.5, 40, 30)
RGB = np.random.default_rng(0).integers(0, 256, (30, 40, 3), np.uint8)
WIDE = np.random.default_rng(0).integers(0, 256, (30, 80, 3), np.uint8)


def read_only(image: np.ndarray) -> np.ndarray:
    return np.frombuffer(image.tobytes(), image.dtype).reshape(image.shape)


SAME: dict[str, tuple[Any, np.ndarray]] = {
    "as it is": (RGB, RGB),
    "read-only": (read_only(RGB), RGB),
    "bgr turned by strides": (RGB[..., ::-1][..., ::-1], RGB),
    "flipped": (RGB[:, ::-1], RGB[:, ::-1]),
    "fortran": (np.asfortranarray(RGB), RGB),
    "every second column": (WIDE[:, ::2], WIDE[:, ::2]),
    "alpha": (np.dstack([RGB, RGB[..., 0]]), RGB),
    "grey": (RGB[..., 0], RGB[..., :1].repeat(3, -1)),
    "grey with an axis": (RGB[..., :1], RGB[..., :1].repeat(3, -1)),
    "torch": (torch.from_numpy(RGB), RGB),
    "torch, channels first": (torch.from_numpy(RGB).permute(2, 0, 1), RGB),
    "torch, a batch of one": (torch.from_numpy(RGB).permute(2, 0, 1)[None], RGB),
    "PIL": (Image.fromarray(RGB), RGB),
    "PIL, grey": (Image.fromarray(RGB[..., 0]), RGB[..., :1].repeat(3, -1)),
    "PIL, palette": (Image.fromarray(RGB[..., 0]).convert("P"), RGB[..., :1].repeat(3, -1)),
}


@pytest.mark.parametrize("name", SAME)
def test_bytes_are_the_same_however_they_come(name: str) -> None:
    image, wanted = SAME[name]
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        frame = prepare_frame(image, CAMERA)
    assert frame.pixels.dtype == torch.uint8 and frame.pixels.shape == (3, 30, 40)
    np.testing.assert_array_equal(frame.pixels.permute(1, 2, 0).numpy(), wanted)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.float64, ">f4", np.longdouble])
def test_floating_point_in_unit_range(dtype: Any) -> None:
    frame = prepare_frame((RGB / 255).astype(dtype), CAMERA)
    assert frame.pixels.dtype == torch.float32
    assert np.abs(frame.pixels.permute(1, 2, 0).numpy() * 255 - RGB).max() < 0.2
    grown = torch.rand(30, 40, 3, requires_grad=True)
    assert not prepare_frame(grown, CAMERA).pixels.requires_grad
    over = RGB / 255 * 1.0005
    assert prepare_frame(over, CAMERA).pixels.max() <= 1  # resampling overshoots


class Message:
    """A sensor_msgs/Image."""

    encoding, data, height, width = "rgb8", b"", 30, 40


BAD: list[tuple[Any, str]] = [
    (RGB.astype(np.uint16) * 16, r"uint16.*4095"),
    (RGB.astype(np.int64), "int64"),
    (RGB > 3, "bool"),
    (RGB.astype(object), "object"),
    (RGB.astype(np.complex64), "complex64"),
    (RGB.astype(np.float32), r"0 to 255; divide it by 255"),
    (RGB / 100, "found 0 to 2.55"),
    (RGB / 255 - 0.5, "found -0.5"),
    (np.full((30, 40, 3), np.nan), "not finite"),
    (RGB[:, :20], "20×30"),
    (RGB[..., :2], "shape"),
    (RGB[None, None], "shape"),
    (Message(), "cv_bridge"),
    (RGB.tolist(), "found list"),
    (None, "found NoneType"),
    ("image.png", "found str"),
    (Image.fromarray((RGB[..., 0] / 2).astype(np.float32)), "divide it by 255"),
    (np.zeros((0, 40, 3)), "40×0"),
]


@pytest.mark.parametrize(("image", "words"), BAD)
def test_everything_else_is_one_sentence(image: Any, words: str) -> None:
    with pytest.raises(InputError, match=words) as caught:
        prepare_frame(image, CAMERA)
    assert "\n" not in str(caught.value)


def test_the_pixels_keep_the_lens_and_can_be_undistorted() -> None:
    camera = Camera(50, 50, 19.5, 14.5, 40, 30, (-0.2, 0.0, 0.0, 0.0))
    frame = prepare_frame(RGB, camera)
    assert frame.camera is camera
    assert frame.undistorted is frame.undistorted and frame.undistorted.camera.lens is None
    expected, _ = camera.undistort(torch.from_numpy(RGB).permute(2, 0, 1))
    found = frame.undistorted
    assert found.camera == camera.full_pinhole and found.camera != camera.pinhole
    left, top = round(found.camera.cx - 19.5), round(found.camera.cy - 14.5)
    assert torch.equal(found.pixels[:, top : top + 30, left : left + 40], expected)
    spread = replace(camera, distortion=(0.2, 0.0, 0.0, 0.0))  # nothing lies outside of it
    undone, pinhole = spread.undistort(torch.from_numpy(RGB).permute(2, 0, 1))
    frame = prepare_frame(RGB, spread)
    assert frame.undistorted.camera == pinhole and torch.equal(frame.undistorted.pixels, undone)
    plain = Frame(frame.pixels, CAMERA)
    assert plain.undistorted is plain


def test_a_frame_of_this_camera_is_returned_as_it_is() -> None:
    lens, zeros = (replace(CAMERA, distortion=(k, 0.0, 0.0, 0.0)) for k in (-0.2, 0.0))
    frame = prepare_frame(RGB, lens)
    for one, camera in (
        (frame, lens),
        (frame, replace(lens)),
        (frame.undistorted, lens),
        (prepare_frame(RGB, zeros), CAMERA),
    ):
        assert prepare_frame(one, camera) is one


OTHERS: dict[str, tuple[Frame, str]] = {
    "size": (prepare_frame(WIDE, replace(CAMERA, width=80)), "Frame is 80×30 .* 40×30"),
    "pixels": (Frame(torch.zeros(3, 30, 80), CAMERA), "Frame is 80×30 .* 40×30"),
    "intrinsics": (prepare_frame(RGB, replace(CAMERA, fx=51, cx=20)), "other fx, cx"),
    "lens": (
        prepare_frame(RGB, replace(CAMERA, distortion=(-0.2, 0.0, 0.0, 0.0))),
        "other distortion",
    ),
}


@pytest.mark.parametrize("name", OTHERS)
def test_a_frame_of_another_camera_is_refused(name: str) -> None:
    frame, words = OTHERS[name]
    with pytest.raises(InputError, match=words):
        prepare_frame(frame, CAMERA)


def test_a_copy_has_pixels_of_its_own() -> None:
    image = RGB.copy()
    frame = prepare_frame(image, CAMERA)
    kept = frame.copy()
    image[:] = 0
    assert not frame.pixels.any() and kept.camera is CAMERA
    np.testing.assert_array_equal(kept.pixels.permute(1, 2, 0).numpy(), RGB)


def test_frames_can_be_compared() -> None:
    one, other = prepare_frame(RGB, CAMERA), prepare_frame(RGB, CAMERA)
    assert one == one and one != other and other in [one, other] and len({one, other}) == 2
