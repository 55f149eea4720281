"""What a camera does behind its lens: pixels, exposure, colour, noise, sharpening, JPEG.

Never blurs: that is the lens (`blur`).
"""

from __future__ import annotations

import torch
from kornia.enhance import (
    adjust_contrast_with_mean_subtraction,
    adjust_saturation_with_gray_subtraction,
    jpeg_codec_differentiable,
)
from torch import Tensor
from torch.nn import functional


def resize(image: Tensor, height: int, width: int) -> Tensor:
    """Images (B, C, H, W) at another resolution; smaller pixels add up in larger ones."""
    return functional.interpolate(
        image, (height, width), mode="bilinear", antialias=True, align_corners=False
    )


def adjust_colour(image: Tensor, gain: Tensor, contrast: Tensor, saturation: Tensor) -> Tensor:
    """Exposure and white balance `gain` (B, 3, 1, 1), then `contrast` and `saturation` (B,)."""
    image = adjust_contrast_with_mean_subtraction(image * gain, contrast)
    adjusted: Tensor = adjust_saturation_with_gray_subtraction(image, saturation)
    return adjusted


def add_noise(
    image: Tensor, noise: Tensor, read: Tensor | float, shot: Tensor | float | None = None
) -> Tensor:
    """Images (B, C, H, W) with standard normal `noise` of their shape.

    `read` is the standard deviation of full white in the dark, `shot` what comes to it at full
    white, as photons are counted: the variances add up, and that of `shot` grows with the light.
    """
    if shot is None:
        return image + noise * read
    return image + noise * (read**2 + shot**2 * image.clamp(0, 1)).sqrt()


def sharpen(image: Tensor, amount: Tensor) -> Tensor:
    """Unsharp masking of images (B, C, H, W) by `amount` (B, 1, 1, 1): seams along every edge."""
    soft = functional.avg_pool2d(image, 3, 1, 1, count_include_pad=False)
    return image + (image - soft) * amount


def compress_jpeg(image: Tensor, quality: Tensor) -> Tensor:
    """Display colours (B, 3, H, W) after JPEG at `quality` (B,), 1 to 100; clamped to [0, 1]."""
    compressed: Tensor = jpeg_codec_differentiable(image.clamp(0, 1), quality)
    return compressed


def to_bytes(image: Tensor) -> Tensor:
    """Display colours in [0, 1] as uint8, rounded."""
    return (image.clamp(0, 1) * 255).round().to(torch.uint8)
