"""Numbers as users have them (lists, arrays, tensors) as the tensors that the library works with.

Never knows what they mean.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..checks import shown
from ..errors import InputError


def float64_of(values: Any, where: str, name: str) -> Tensor:
    """Numbers of any kind as float64 on the CPU, without a gradient; `InputError` for others."""
    if isinstance(values, Tensor):
        return values.detach().to("cpu", torch.float64)
    try:
        return torch.from_numpy(np.array(values, dtype=np.float64))
    except (TypeError, ValueError, OverflowError, RecursionError, RuntimeError):
        raise InputError(f"{where}: the {name} must be numbers, found {shown(values)}.") from None


def floating(values: Any, where: str, name: str) -> Tensor:
    """A tensor of floating point numbers as it is, so that gradients flow; others as float64.

    Whole numbers too, as lengths and pixels rounded to integers would be wrong.
    """
    if isinstance(values, Tensor):
        return values if values.is_floating_point() else values.to(torch.float64)
    return float64_of(values, where, name)


def vectors(values: Any, length: int, where: str, name: str) -> Tensor:
    """Vectors (..., length), as `floating`; `InputError` for any other shape."""
    found = floating(values, where, name)
    if found.shape[-1:] != (length,):
        raise InputError(
            f"{where}: {name} must be (..., {length}), found shape {tuple(found.shape)}."
        )
    return found
