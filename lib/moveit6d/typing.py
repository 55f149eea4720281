"""Names for what functions take and return: arrays, and ranges of numbers.

Never checks anything at run time.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

Float32: TypeAlias = NDArray[np.float32]
Float64: TypeAlias = NDArray[np.float64]
Mask: TypeAlias = NDArray[np.bool_]
RGBImage: TypeAlias = NDArray[np.uint8]  # (H, W, 3)
Range: TypeAlias = tuple[float, float]  # from, to

# An image as users have it: RGB (H, W, 3), uint8 or floating point in [0, 1].
ImageLike: TypeAlias = NDArray[np.uint8] | NDArray[np.floating[Any]] | Tensor
# Numbers in any of the usual containers: lists, NumPy arrays of any type, tensors.
Numbers: TypeAlias = Tensor | NDArray[np.number[Any]] | Sequence[float] | Sequence[Sequence[float]]
