"""Images as OpenCV, ROS, PIL and torch hand them over: checked, as tensors or as RGB bytes.

Never opens a file and never crops anything.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..errors import InputError
from ..typing import ImageLike
from .camera import Camera

ROUNDING = 1e-3  # by which resampled floating point images may leave [0, 1]


def image_tensor(image: ImageLike | None, camera: Camera | None = None) -> Tensor:
    """An RGB image (H, W, 3) or (3, H, W) as a tensor (3, H, W), uint8 or float32 in [0, 1].

    Arrays (read-only and with any strides too), tensors and PIL images; uint8, or floating point
    in [0, 1]. Grey images become RGB, a fourth channel (alpha) is left out. Raises `InputError`
    for anything else, for numbers that are not finite and for a size that is not the camera's.
    """
    tensor = _channels_last(_tensor(image), camera)
    if camera is not None:
        check_size("Image", tensor.shape[1], tensor.shape[0], camera)
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
    return tensor.permute(2, 0, 1)


def rgb_bytes(image: ImageLike | None, camera: Camera | None = None) -> NDArray[np.uint8]:
    """The same as RGB (H, W, 3) uint8, for who draws on it or paints with it.

    >>> rgb_bytes(np.full((2, 2), 0.5)).tolist()
    [[[128, 128, 128], [128, 128, 128]], [[128, 128, 128], [128, 128, 128]]]
    """
    pixels = image_tensor(image, camera).permute(1, 2, 0)
    if pixels.is_floating_point():
        pixels = (255 * pixels).round().to(torch.uint8)
    return np.asarray(pixels.numpy())


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


def _channels_last(tensor: Tensor, camera: Camera | None) -> Tensor:
    """Pixels (H, W, 3)."""
    found = tuple(tensor.shape)
    if tensor.dim() == 4 and len(tensor) == 1:
        tensor = tensor[0]
    if tensor.dim() == 2:
        tensor = tensor[..., None]
    elif tensor.dim() == 3 and tensor.shape[0] in (1, 3, 4):
        if camera is None:
            first = tensor.shape[-1] not in (1, 3, 4)
        else:
            first = tensor.shape[1:] == (camera.height, camera.width)
        tensor = tensor.permute(1, 2, 0) if first else tensor
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
