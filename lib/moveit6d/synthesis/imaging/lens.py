"""Errors of a lens and of intrinsics: what remains in a crop that no pose explains.

Never models a known lens: those are undistorted in `geometry.lens`.
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional


def apply_lens_error(image: Tensor, coefficients: Tensor, displacement: Tensor) -> Tensor:
    """Square images (B, C, N, N) as a slightly wrong lens shows them.

    What a camera file gets wrong is seen as a shift and a scale, which no tracker can tell from a
    pose, and as what is left in the crop: unequal focal lengths, shear, and radial distortion about
    a point that is not the crop's middle. Only the rest is applied. `coefficients` (5, B, 1, 1) in
    [-1, 1] are stretch, shear, radial distortion and the x and y of its centre; they are scaled so
    that the pixel that is displaced most is displaced by `displacement` (B,) pixels.
    """
    size = image.shape[-1]
    line = torch.linspace(-1, 1, size, device=image.device)
    y, x = torch.meshgrid(line, line, indexing="ij")
    stretch, shear, radial, aside, below = coefficients
    away = radial * ((x - 0.5 * aside) ** 2 + (y - 0.5 * below) ** 2)
    pixels = torch.stack([x, y], -1)  # (N, N, 2)
    field = torch.stack([(stretch + away) * x + shear * y, shear * x + (away - stretch) * y], -1)
    field = field - field.mean((1, 2), keepdim=True)  # no shift …
    size_change = (field * pixels).sum((1, 2, 3)) / pixels.square().sum()
    field = field - size_change[:, None, None, None] * pixels  # … and no scale is left
    largest = field.norm(dim=-1).flatten(1).amax(1).clamp_min(1e-6)
    scale = (displacement / largest * 2 / (size - 1))[:, None, None, None]
    grid = pixels + field * scale
    return functional.grid_sample(image, grid, padding_mode="border", align_corners=True)
