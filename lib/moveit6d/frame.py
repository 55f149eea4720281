"""Checked images with the camera that took them.

Never crops an object out of them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property

from torch import Tensor

from .errors import InputError
from .geometry.camera import Camera
from .geometry.images import check_size as check_size
from .geometry.images import image_tensor
from .typing import ImageLike


@dataclass(frozen=True, eq=False)
class Frame:
    """A checked image: pixels (3, H, W) uint8 or float in [0, 1], and the camera that took it.

    The pixels are as the lens drew them: `crop_patch` takes the camera's lens and sees through it.
    Two frames are equal only if they are the same object.
    """

    pixels: Tensor
    camera: Camera

    @cached_property
    def intrinsics(self) -> Tensor:
        """The camera's matrix K, float64 (3, 3)."""
        return self.camera.matrix

    @cached_property
    def undistorted(self) -> Frame:
        """The frame as a pinhole would have taken it, for who needs the image as a whole.

        Its camera is the `full_pinhole`, so that a wide lens's border is in it.
        """
        if self.camera.lens is None:
            return self
        return Frame(*self.camera.undistort(self.pixels, full=True))

    def copy(self) -> Frame:
        """The frame with pixels of its own, for who keeps it: the caller may reuse the image."""
        return replace(self, pixels=self.pixels.clone())


def prepare_frame(image: ImageLike | Frame | None, camera: Camera) -> Frame:
    """An RGB image (H, W, 3) or (3, H, W) as a `Frame`; a `Frame` of the camera as it is.

    Arrays, tensors and PIL images, uint8 or floating point in [0, 1] (`geometry.images`). Raises
    `InputError` for anything else, for a size that is not the camera's and for a `Frame` of another
    camera; without its lens (`Frame.undistorted`) it is the same camera.

    >>> import numpy as np
    >>> camera = Camera(300, 300, 160, 120, 320, 240)
    >>> frame = prepare_frame(np.zeros((240, 320, 3), np.uint8), camera)
    >>> tuple(frame.pixels.shape)
    (3, 240, 320)
    """
    if isinstance(image, Frame):
        _check_camera(image, camera)
        return image
    return Frame(image_tensor(image, camera), camera)


def _check_camera(frame: Frame, camera: Camera) -> None:
    """`InputError` for a frame that this camera did not take, with its lens or undistorted."""
    height, width = frame.pixels.shape[-2:]
    own = frame.camera
    is_whole = (width, height) == (own.width, own.height)
    if is_whole and (own == camera or _is_undistorted(own, camera)):
        return
    check_size("Frame", width, height, camera)
    names = [one.name for one in fields(Camera)]
    other = ", ".join(name for name in names if getattr(own, name) != getattr(camera, name))
    raise InputError(
        f"Frame was prepared for a camera with other {other}; give the image itself, or prepare it "
        "with this camera."
    )


def _is_undistorted(own: Camera, camera: Camera) -> bool:
    """Whether a frame's own camera is that of `Frame.undistorted` of another camera's frames."""
    return own.lens is None and own.pinhole == camera.full_pinhole
