"""Images of every kind as tensors and as RGB bytes, with a camera's size and without."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.images import image_tensor, rgb_bytes

RGB = np.random.default_rng(0).integers(0, 256, (30, 40, 3), np.uint8)
GREY = RGB[..., :1].repeat(3, -1)
KINDS: list[tuple[Any, np.ndarray]] = [
    (RGB, RGB),
    (RGB / 255, RGB),
    (np.dstack([RGB, RGB[..., 0]]), RGB),
    (RGB[..., 0], GREY),
    (torch.from_numpy(RGB).permute(2, 0, 1), RGB),
    (torch.from_numpy(RGB).permute(2, 0, 1)[None], RGB),
    (Image.fromarray(RGB), RGB),
]


@pytest.mark.parametrize("camera", [None, Camera(50, 50, 19.5, 14.5, 40, 30)])
@pytest.mark.parametrize("number", range(len(KINDS)))
def test_bytes_are_the_same_however_they_come(number: int, camera: Camera | None) -> None:
    image, wanted = KINDS[number]
    found = rgb_bytes(image, camera)
    assert found.dtype == np.uint8
    np.testing.assert_array_equal(found, wanted)
    assert tuple(image_tensor(image, camera).shape) == (3, 30, 40)


def test_three_columns_are_no_channels() -> None:
    tall = np.zeros((3, 5, 3), np.uint8)
    assert rgb_bytes(tall).shape == (3, 5, 3)


def test_without_a_camera_any_size_will_do_and_with_one_only_its_own() -> None:
    assert rgb_bytes(RGB[::2]).shape == (15, 40, 3)
    with pytest.raises(InputError, match="is 40×15 but the camera is 40×30"):
        rgb_bytes(RGB[::2], Camera(50, 50, 19.5, 14.5, 40, 30))
    with pytest.raises(InputError, match="divide it by 255"):
        rgb_bytes(RGB.astype(np.float32))
