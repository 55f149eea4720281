"""A few rotations that cover all of them about evenly, for searches without a start.

Never random: the same number of rotations is the same set every time.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..errors import InputError
from .rotation import from_quaternion

# Alexa, "Super-Fibonacci Spirals" (CVPR 2022): the pair that spreads quaternions most evenly.
_PHI = math.sqrt(2.0)
_PSI = 1.533751168755204288118041


def rotation_grid(count: int) -> Tensor:
    """`count` rotations spread evenly over SO(3), float64: (count, 3, 3).

    Super-Fibonacci spirals. With 60 no rotation is farther than about 60 degrees from the nearest
    of them, with 200 about 36, with 1000 about 20. Raises `InputError` for fewer than one.
    """
    if count < 1:
        raise InputError(f"rotation_grid: {count} rotations asked for, at least 1 is needed.")
    place = torch.arange(count, dtype=torch.float64) + 0.5
    inner, outer = (place / count).sqrt(), (1 - place / count).sqrt()
    alpha, beta = 2 * math.pi * place / _PHI, 2 * math.pi * place / _PSI
    x, y, z, w = inner * alpha.sin(), inner * alpha.cos(), outer * beta.sin(), outer * beta.cos()
    return from_quaternion(torch.stack([w, x, y, z], -1))
