"""Images as users have them become frames."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.frame import Frame, prepare_frame
from moveit6d.geometry.camera import Camera

CAMERA = Camera(30, 30, 7.5, 5.5, 16, 12)


def test_arrays_and_tensors_are_taken() -> None:
    image = np.random.default_rng(0).integers(0, 255, (12, 16, 3), dtype=np.uint8)
    for given in (image, torch.from_numpy(image), image[:, ::-1], np.asfortranarray(image)):
        frame = prepare_frame(given, CAMERA)
        expected = torch.from_numpy(np.array(given)).permute(2, 0, 1)
        assert torch.equal(frame.pixels, expected) and frame.pixels.is_contiguous()
    floating = prepare_frame(image / 255.0, CAMERA)
    assert floating.pixels.dtype is torch.float32
    assert prepare_frame(floating, CAMERA) is floating
    assert torch.equal(floating.intrinsics, CAMERA.matrix)


@pytest.mark.parametrize("image", [None, "picture.png", np.zeros((12, 16)), np.zeros((3, 4, 3))])
def test_anything_else_is_refused(image: object) -> None:
    with pytest.raises(InputError, match="Image"):
        prepare_frame(image, CAMERA)  # type: ignore[arg-type]


def test_a_frame_knows_its_camera_without_distortion() -> None:
    lens = Camera(30, 30, 7.5, 5.5, 16, 12, (0.1, 0.0, 0.0, 0.0, 0.0))
    frame = prepare_frame(np.zeros((12, 16, 3), np.uint8), lens)
    assert isinstance(frame, Frame) and frame.camera.distortion is None
