"""Blur: defocus, linear motion and zoom, of linear light if it is to look as in a camera.

Never moves the image: every kernel is symmetric.
"""

from __future__ import annotations

import math

import torch
from kornia.filters import filter2d, gaussian_blur2d
from torch import Tensor
from torch.nn import functional

ZOOMS = (-0.5, -0.25, 0.0, 0.25, 0.5)  # of the exposure, at which a zoom is sampled


def gaussian_blur(image: Tensor, sigma: Tensor, radius: int | None = None) -> Tensor:
    """Images (B, C, H, W) blurred by standard deviations (B,) pixels; the border is replicated.

    `radius` is that of the kernel, three of the largest standard deviation unless given.
    """
    reach = max(1, math.ceil(3 * float(sigma.max()))) if radius is None else radius
    spread = sigma[:, None].expand(-1, 2)
    blurred: Tensor = gaussian_blur2d(image, 2 * reach + 1, spread, "replicate")
    return blurred


def motion_blur(
    image: Tensor, sigma: Tensor, length: Tensor, angle: Tensor, radius: int = 6
) -> Tensor:
    """Defocus and linear motion of images (B, C, H, W) as one oriented Gaussian each.

    `sigma` (B,) is the defocus, `length` (B,) that of the motion, both in pixels, `angle` (B,) its
    direction in radians. A uniform motion of length L has the variance L² / 12.
    """
    along, across = (sigma**2 + length**2 / 12)[:, None, None], (sigma**2)[:, None, None]
    line = torch.arange(-radius, radius + 1, device=image.device, dtype=torch.float32)
    y, x = torch.meshgrid(line, line, indexing="ij")
    cosine, sine = angle.cos()[:, None, None], angle.sin()[:, None, None]
    forward, aside = x * cosine + y * sine, y * cosine - x * sine
    kernel = torch.exp(-0.5 * (forward**2 / along + aside**2 / across))
    blurred: Tensor = filter2d(image, kernel, normalized=True, border_type="replicate")
    return blurred


def radial_blur(image: Tensor, zoom: Tensor) -> Tensor:
    """Images (B, C, H, W) whose scale changes by `zoom` (B,) about the middle while exposed."""
    total = torch.zeros_like(image)
    for share in ZOOMS:
        affine = (
            torch.eye(2, 3, device=image.device).repeat(len(image), 1, 1)
            * (1 + share * zoom)[:, None, None]
        )
        grid = functional.affine_grid(affine, list(image.shape), align_corners=False)
        total += functional.grid_sample(image, grid, padding_mode="border", align_corners=False)
    return total / len(ZOOMS)
