"""Pictures of more than eight bits a channel as the eight that everything here works with.

Never opens a file by itself. What the numbers of such a picture mean is written in hardly any file:
the rules are in `to_rgb8`'s text, and what fits none of them is an error.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

BITS = (10, 12, 14, 16)  # that cameras write in 16


class BitDepth:
    """How many bits the pictures of one source have: as many as their largest number so far needs.

    It never goes back, so that a video's dark frames stay dark; 0 before the first of them.
    """

    bits = 0

    def of(self, largest: float) -> int:
        """The bits, now that a picture with this largest number has come."""
        self.bits = max(self.bits, next(bits for bits in BITS if largest < 2**bits))
        return self.bits


def to_rgb8(picture: Any, path: Path, depth: BitDepth | None = None) -> NDArray[np.uint8]:
    """A picture that PIL has opened as RGB (H, W, 3) uint8.

    16 bits: the whole range, or the lower 10, 12 or 14 bits if no number of this picture, or of
    those that `depth` has seen, is larger: so industrial cameras write them. Floating point: 0 to
    1, or 0 to 255 if a number is larger than 1; `InputError` for negative, larger and non-finite
    ones. Grey becomes RGB.
    """
    if picture.mode == "F":
        return _grey(_float_to_8(np.asarray(picture, np.float64), path))
    if picture.mode.startswith("I"):
        return _grey(_16_to_8(np.asarray(picture).astype(np.float64), path, depth))
    return np.array(picture.convert("RGB"))


def _grey(values: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.repeat(values[..., None], 3, -1)


def _16_to_8(values: NDArray[Any], path: Path, depth: BitDepth | None) -> NDArray[np.uint8]:
    low, high = float(values.min(initial=0)), float(values.max(initial=0))
    if low < 0 or high > 65535:
        raise InputError(f"{path} holds numbers from {low:.0f} to {high:.0f}; 16 bits are read.")
    bits = (depth or BitDepth()).of(high)
    if bits < 16:
        return np.asarray((values * (255 / (2**bits - 1))).round().astype(np.uint8))
    return np.asarray((values / 257).astype(np.uint8))


def _float_to_8(values: NDArray[np.float64], path: Path) -> NDArray[np.uint8]:
    if not np.isfinite(values).all():
        raise InputError(f"{path} holds numbers that are not finite.")
    low, high = float(values.min(initial=0)), float(values.max(initial=0))
    if low < 0 or high > 255:
        raise InputError(
            f"{path} holds floating point numbers from {low:.3g} to {high:.3g}; scale them to "
            "0 … 1 or save the picture with 8 or 16 bits."
        )
    return np.asarray((values * (255 if high <= 1 else 1)).round().astype(np.uint8))


def is_deep(picture: Any) -> bool:
    """Whether an RGB picture's file has 16 bits a channel, of which PIL keeps the upper eight."""
    return any(";16" in str(part) for part in getattr(picture, "tile", ()))


def deep_rgb(path: Path, depth: BitDepth | None = None) -> NDArray[np.uint8]:
    """The RGB picture of such a file, turned upright, by the rule for 16 bits of `to_rgb8`."""
    import cv2

    values = cv2.imread(str(path), cv2.IMREAD_ANYDEPTH | cv2.IMREAD_COLOR)
    if values is None:
        raise InputError(f"{path} is not a readable image of 16 bits a channel.")
    return np.ascontiguousarray(_16_to_8(values[..., ::-1].astype(np.float64), path, depth))
