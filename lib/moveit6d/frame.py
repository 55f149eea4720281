"""Images as OpenCV, ROS, PIL and torch hand them over: checked, as tensors.

Never crops an object out of them.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from .errors import InputError
from .geometry.camera import Camera
from .typing import ImageLike

ROUNDING = 1e-3  # by which resampled floating point images may leave [0, 1]


@dataclass(frozen=True)
class Frame:
    """A checked image: pixels (3, H, W) uint8 or float in [0, 1], and the camera that took it.

    The pixels are as the lens drew them: `crop_patch` takes the camera's lens and sees through it.
    """

    pixels: Tensor
    camera: Camera

    @cached_property
    def intrinsics(self) -> Tensor:
        """The camera's matrix K, float64 (3, 3)."""
        return self.camera.matrix

    @cached_property
    def undistorted(self) -> Frame:
        """The frame as a pinhole would have taken it, for who needs the image as a whole."""
        if self.camera.lens is None:
            return self
        return Frame(*self.camera.undistort(self.pixels))

    def copy(self) -> Frame:
        """The frame with pixels of its own, for who keeps it: the caller may reuse the image."""
        return replace(self, pixels=self.pixels.clone())


def prepare_frame(image: ImageLike | Frame | None, camera: Camera) -> Frame:
    """An RGB image (H, W, 3) or (3, H, W) as a `Frame`; a `Frame` of the camera as it is.

    Arrays (read-only and with any strides too), tensors and PIL images; uint8, or floating point
    in [0, 1]. Grey images become RGB, a fourth channel (alpha) is left out. Raises `InputError`
    for anything else, for numbers that are not finite, for a size that is not the camera's and for
    a `Frame` of another camera; without its lens (`Frame.undistorted`) it is the same camera.

    >>> camera = Camera(300, 300, 160, 120, 320, 240)
    >>> frame = prepare_frame(np.zeros((240, 320, 3), np.uint8), camera)
    >>> tuple(frame.pixels.shape)
    (3, 240, 320)
    """
    if isinstance(image, Frame):
        _check_camera(image, camera)
        return image
    tensor = _channels_last(_tensor(image), camera)
    height, width = tensor.shape[:2]
    check_size("Image", width, height, camera)
    if tensor.is_floating_point():
        tensor = _in_unit_range(tensor)
    elif tensor.dtype == torch.uint16:
        raise InputError(
            "Image is uint16; scale it to [0, 1] first: image / 65535, or image / 4095 if it has "
            "12 bits."
        )
    elif tensor.dtype != torch.uint8:
        kind = str(tensor.dtype).removeprefix("torch.")
        raise InputError(f"Image must be uint8 or floating point in [0, 1], found {kind}.")
    return Frame(tensor.permute(2, 0, 1), camera)


def _check_camera(frame: Frame, camera: Camera) -> None:
    """`InputError` for a frame that this camera did not take, with its lens or undistorted."""
    height, width = frame.pixels.shape[-2:]
    check_size("Frame", width, height, camera)
    own = frame.camera
    if own == camera or (own.lens is None and own.pinhole == camera.pinhole):
        return
    names = [one.name for one in fields(Camera)]
    other = ", ".join(name for name in names if getattr(own, name) != getattr(camera, name))
    raise InputError(
        f"Frame was prepared for a camera with other {other}; give the image itself, or prepare it "
        "with this camera."
    )


def check_size(name: str, width: int, height: int, camera: Camera) -> None:
    """`InputError` for an image of another size than the camera's; says the intrinsics of this."""
    if (width, height) == (camera.width, camera.height):
        return
    hint = ""
    if abs(height * camera.width / camera.height - width) < 1:  # sizes are rounded to pixels
        own = camera.resize(width, height)
        hint = (
            f" (if the whole picture was scaled: fx {own.fx:.6g}, fy {own.fy:.6g}, "
            f"cx {own.cx:.6g}, cy {own.cy:.6g})"
        )
    raise InputError(
        f"{name} is {width}×{height} but the camera is {camera.width}×{camera.height}; give the "
        f"intrinsics of {width}×{height}{hint}."
    )


def _tensor(image: Any) -> Tensor:
    """Whatever holds pixels as a tensor on the CPU."""
    if isinstance(image, Tensor):
        return image.detach().cpu()
    if hasattr(image, "convert") and hasattr(image, "mode"):  # PIL's
        deep = image.mode in ("F", "I") or image.mode.startswith("I;")
        image = np.asarray(image if deep else image.convert("RGB"))
    if not isinstance(image, np.ndarray):
        found = type(image).__name__
        hint = ""
        if hasattr(image, "encoding") and hasattr(image, "data"):
            hint = "; cv_bridge's imgmsg_to_cv2(message, 'rgb8') makes one of a ROS message"
        raise InputError(f"Image: expected an array (H, W, 3), found {found}{hint}.")
    return _from_numpy(image)


def _from_numpy(image: NDArray[Any]) -> Tensor:
    """A tensor of an array, without a copy where torch can share it."""
    if image.dtype.kind not in "biuf":
        raise InputError(f"Image must be uint8 or floating point in [0, 1], found {image.dtype}.")
    native = image.dtype.newbyteorder("=")
    if native.itemsize > 8:  # long double
        native = np.dtype(np.float64)
    # Torch knows no negative strides, warns of read-only memory and takes native numbers only.
    shares = image.flags.writeable and image.dtype == native and min(image.strides, default=0) >= 0
    return torch.from_numpy(image if shares else np.array(image, native, order="C"))


def _channels_last(tensor: Tensor, camera: Camera) -> Tensor:
    """Pixels (H, W, 3)."""
    found = tuple(tensor.shape)
    if tensor.dim() == 4 and len(tensor) == 1:
        tensor = tensor[0]
    size = (camera.height, camera.width)
    if tensor.dim() == 2:
        tensor = tensor[..., None]
    elif tensor.dim() == 3 and tensor.shape[0] in (1, 3, 4) and tensor.shape[1:] == size:
        tensor = tensor.permute(1, 2, 0)
    if tensor.dim() != 3 or tensor.shape[-1] not in (1, 3, 4):
        raise InputError(f"Image: expected shape (H, W, 3) in RGB, found {found}.")
    return tensor.expand(-1, -1, 3) if tensor.shape[-1] == 1 else tensor[..., :3]


def _in_unit_range(tensor: Tensor) -> Tensor:
    if not tensor.numel() or not torch.isfinite(tensor).all():
        raise InputError("Image holds numbers that are not finite.")
    low, high = float(tensor.min()), float(tensor.max())
    if low < -ROUNDING or high > 1 + ROUNDING:
        hint = "; divide it by 255" if 1 < high <= 255 and low >= 0 else ""
        raise InputError(
            f"Image of floating point numbers must lie in [0, 1], found {low:.3g} to {high:.3g}"
            f"{hint}."
        )
    return tensor.to(torch.float32).clamp(0, 1)
