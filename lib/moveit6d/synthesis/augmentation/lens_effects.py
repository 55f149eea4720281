"""What a camera does to a picture: blur, focus, a lens that is not quite known, colour, noise.

Never knows what the picture shows. Batched tensor arithmetic through kornia on (B, C, N, N), most
of it on a random part of the batch; all randomness comes from the random source that is handed in.
"""

from __future__ import annotations

import torch
from kornia.enhance import (
    adjust_contrast_with_mean_subtraction,
    adjust_saturation_with_gray_subtraction,
    jpeg_codec_differentiable,
)
from kornia.filters import filter2d, gaussian_blur2d
from torch import Tensor
from torch.nn import functional

from .augment import AugmentConfig, RandomSource

SHARPEST = 0.2  # pixels: standard deviation of the narrowest blur that a kernel can show


def blur(picture: Tensor, config: AugmentConfig, rng: RandomSource) -> Tensor:
    """Defocus and motion blur of a part of the batch by one oriented Gaussian each."""
    chosen = rng.chance(len(picture), config.blurred).nonzero()[:, 0]
    if not len(chosen):
        return picture
    count = len(chosen)
    defocus = rng.uniform(count, between=config.defocus).clamp_min(SHARPEST)
    # A smear of length L has the variance L² / 12.
    length = motion_blur_lengths(count, config, rng) * rng.chance(count, config.motion_blurred)
    angle = rng.uniform(count, between=(0.0, 3.14159))
    along, across = (defocus**2 + length**2 / 12)[:, None, None], (defocus**2)[:, None, None]
    line = torch.arange(-6, 7).float()
    y, x = torch.meshgrid(line, line, indexing="ij")
    cosine, sine = angle.cos()[:, None, None], angle.sin()[:, None, None]
    forward, aside = x * cosine + y * sine, y * cosine - x * sine
    kernel = torch.exp(-0.5 * (forward**2 / along + aside**2 / across))
    picture = picture.clone()
    picture[chosen] = filter2d(picture[chosen], kernel, normalized=True, border_type="replicate")
    return picture


def motion_blur_lengths(count: int, config: AugmentConfig, rng: RandomSource) -> Tensor:
    """Lengths (count,) of motion blur in pixels of a patch of 128."""
    if config.motion_sigma > 0:
        return rng.normal(count).abs() * config.motion_sigma * 128
    return rng.uniform(count, between=config.motion)


def radial_blur(picture: Tensor, config: AugmentConfig, rng: RandomSource) -> Tensor:
    """Zoom blur about the middle of a part of the batch: the mean of five scales."""
    chosen = rng.chance(len(picture), config.radial).nonzero()[:, 0]
    if not len(chosen):
        return picture
    strength = rng.normal(len(chosen)) * config.radial_sigma
    part = picture[chosen]
    total = torch.zeros_like(part)
    for share in (-0.5, -0.25, 0.0, 0.25, 0.5):
        affine = torch.eye(2, 3).repeat(len(chosen), 1, 1) * (1 + share * strength)[:, None, None]
        grid = functional.affine_grid(affine, list(part.shape), align_corners=False)
        total += functional.grid_sample(part, grid, padding_mode="border", align_corners=False)
    picture = picture.clone()
    picture[chosen] = total / 5
    return picture


def defocus_background(photos: Tensor, config: AugmentConfig, rng: RandomSource) -> Tensor:
    """Backgrounds that lie out of focus, a part of the batch."""
    chosen = rng.chance(len(photos), config.background_blurred).nonzero()[:, 0]
    if not len(chosen):
        return photos
    spread = rng.uniform(len(chosen), 1, between=config.background_blur).expand(-1, 2)
    photos = photos.clone()
    photos[chosen] = gaussian_blur2d(photos[chosen], 13, spread, "replicate")
    return photos


def perturb_lens(picture: Tensor, config: AugmentConfig, rng: RandomSource) -> Tensor:
    """Errors of the lens and of the intrinsics, up to so many pixels at the patch's corners.

    What the camera file gets wrong is seen as a shift and a scale, which no tracker can tell from
    a pose, and as what is left in the patch: unequal focal lengths, shear, and radial distortion
    about a point that is not the patch's middle. Only the rest is drawn here.
    """
    batch, _, size, _ = picture.shape
    chosen = rng.chance(batch, config.lens_error).nonzero()[:, 0]
    if not len(chosen):
        return picture
    count = len(chosen)
    line = torch.linspace(-1, 1, size)
    y, x = torch.meshgrid(line, line, indexing="ij")
    stretch, shear, radial, aside, below = rng.uniform(5, count, 1, 1, between=(-1.0, 1.0))
    away = radial * ((x - 0.5 * aside) ** 2 + (y - 0.5 * below) ** 2)
    place = torch.stack([x, y], -1)  # (N, N, 2)
    move = torch.stack([(stretch + away) * x + shear * y, shear * x + (away - stretch) * y], -1)
    move = move - move.mean((1, 2), keepdim=True)  # no shift …
    size_change = (move * place).sum((1, 2, 3)) / place.square().sum()
    move = move - size_change[:, None, None, None] * place  # … and no scale is left
    largest = move.norm(dim=-1).flatten(1).amax(1).clamp_min(1e-6)
    pixels = rng.uniform(count, between=config.lens_error_pixels)
    scale = (pixels / largest * 2 / (size - 1))[:, None, None, None]
    grid = place + move * scale
    picture = picture.clone()
    picture[chosen] = functional.grid_sample(
        picture[chosen], grid, padding_mode="border", align_corners=True
    )
    return picture


def sharpen(picture: Tensor, config: AugmentConfig, rng: RandomSource) -> Tensor:
    """What many cameras do to their pictures: bright and dark seams along every edge."""
    chosen = rng.chance(len(picture), config.sharpened).nonzero()[:, 0]
    if not len(chosen):
        return picture
    part = picture[chosen]
    strength = rng.uniform(len(chosen), 1, 1, 1, between=config.sharpness)
    soft = functional.avg_pool2d(part, 3, 1, 1, count_include_pad=False)
    picture = picture.clone()
    picture[chosen] = part + (part - soft) * strength
    return picture


def degrade(picture: Tensor, config: AugmentConfig, rng: RandomSource, groups: int = 4) -> Tensor:
    """Lower resolution and JPEG blocks, one setting a group of the batch."""
    size = picture.shape[-1]
    parts = []
    for part in picture.chunk(groups):
        small = part
        if rng.uniform(1).item() < config.downsampled:
            side = round(size * rng.uniform(1, between=config.resolution).item())
            small = functional.interpolate(
                part, (side, side), mode="bilinear", antialias=True, align_corners=False
            )
        if rng.uniform(1).item() < config.jpeg:
            quality = rng.uniform(len(part), between=config.jpeg_quality)
            small = jpeg_codec_differentiable(small.clamp(0, 1), quality)
        if small.shape[-1] != size:
            small = functional.interpolate(
                small, (size, size), mode="bilinear", align_corners=False
            )
        parts.append(small)
    return torch.cat(parts)


def recolour(picture: Tensor, config: AugmentConfig, rng: RandomSource) -> Tensor:
    """Exposure, contrast, saturation, white balance and sensor noise."""
    batch = len(picture)
    gain = 1 + rng.uniform(batch, 3, 1, 1, between=(-1.0, 1.0)) * config.channel_gain
    picture = picture * (gain * rng.uniform(batch, 1, 1, 1, between=config.brightness))
    picture = adjust_contrast_with_mean_subtraction(
        picture, rng.uniform(batch, between=config.contrast)
    )
    picture = adjust_saturation_with_gray_subtraction(
        picture, rng.uniform(batch, between=config.saturation)
    )
    if config.noise[1] <= 0:
        return picture
    noise = rng.normal(*picture.shape)
    return picture + noise * rng.uniform(batch, 1, 1, 1, between=config.noise)
