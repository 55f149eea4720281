"""Images as they come in: checked, undistorted, as tensors.

Never crops an object out of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import torch
from torch import Tensor

from .errors import InputError
from .geometry.camera import Camera
from .typing import ImageLike


@dataclass(frozen=True)
class Frame:
    """A checked image: pixels (3, H, W) uint8 or float in [0, 1], and its pinhole camera."""

    pixels: Tensor
    camera: Camera

    @cached_property
    def intrinsics(self) -> Tensor:
        """The camera's matrix K, float64 (3, 3)."""
        return self.camera.matrix


def prepare_frame(image: ImageLike | Frame | None, camera: Camera) -> Frame:
    """An RGB image (H, W, 3) without lens distortion; a `Frame` is returned as it is.

    uint8, or floating point in [0, 1]. Raises `InputError` for anything else, for numbers that are
    not finite and for a size that is not the camera's.

    >>> camera = Camera(300, 300, 160, 120, 320, 240)
    >>> frame = prepare_frame(np.zeros((240, 320, 3), np.uint8), camera)
    >>> tuple(frame.pixels.shape)
    (3, 240, 320)
    """
    if isinstance(image, Frame):
        return image
    if not isinstance(image, (np.ndarray, Tensor)):
        raise InputError(f"Image: expected an array (H, W, 3), found {type(image).__name__}.")
    tensor = torch.as_tensor(
        np.ascontiguousarray(image) if isinstance(image, np.ndarray) else image
    )
    if tensor.dim() != 3 or tensor.shape[-1] != 3:
        raise InputError(f"Image: expected shape (H, W, 3) in RGB, found {tuple(tensor.shape)}.")
    height, width = tensor.shape[:2]
    if (width, height) != (camera.width, camera.height):
        raise InputError(
            f"Image is {width}×{height} but the camera is {camera.width}×{camera.height}; "
            "give the intrinsics of this resolution (Camera.resize converts them)."
        )
    if tensor.is_floating_point():
        if not torch.isfinite(tensor).all():
            raise InputError("Image holds numbers that are not finite.")
        if tensor.min() < 0 or tensor.max() > 1:
            raise InputError("Image of floating point numbers must lie in [0, 1].")
        tensor = tensor.to(torch.float32)
    elif tensor.dtype != torch.uint8:
        raise InputError(f"Image must be uint8 or floating point, found {tensor.dtype}.")
    # Contiguous: every iteration cuts a window out of it.
    return Frame(*camera.undistort(tensor.permute(2, 0, 1).contiguous()))
