"""Renderings whose colours are wrong, as those of scanned, modelled and reduced meshes are.

Never knows poses. The observed object keeps its true colours; only what a network is shown as the
rendering, and the templates of the descriptors, come through here.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import torch
from torch import Tensor
from torch.nn import functional

from ...geometry.crop import PATCH_SIZE
from ...rendering.renderer import GBuffer
from ...rendering.shading import shade_plain
from ...typing import Range
from ..augmentation.random_source import RandomSource
from ..imaging.blur import gaussian_blur


@dataclass(frozen=True)
class PoorTextureConfig:
    """Textures of few pixels, colours of vertices, washed-out scans.

    Args:
        probability: of such a texture.
        blur: standard deviation in pixels of the crop.
        contrast: factor of the difference from the texture's mean.
        saturation: factor of the difference from grey.
        gain: largest relative error of a channel, beside that of all textures.
    """

    probability: float = 0.0
    blur: Range = (0.5, 3.0)
    contrast: Range = (0.4, 1.0)
    saturation: Range = (0.3, 1.2)
    gain: float = 0.2


@dataclass(frozen=True)
class TextureColourConfig:
    """Colours of the rendering that differ from the object's, as those of scanned meshes do.

    Args:
        gain: largest relative error of a channel, the same everywhere.
        varying_gain: the same, varying smoothly over the rendering.
        poor: textures of poor quality.
    """

    gain: float = 0.2
    varying_gain: float = 0.0
    poor: PoorTextureConfig = field(default_factory=PoorTextureConfig)


def wrong_colours(rendered: GBuffer, config: TextureColourConfig, rng: RandomSource) -> Tensor:
    """The rendering (B, 3, 128, 128) under the plain lamp, with errors of its texture's colours."""
    batch = len(rendered.mask)
    gain = rng.uniform(batch, 3, 1, 1, between=(-1.0, 1.0)) * config.gain
    if config.varying_gain > 0:
        coarse = rng.uniform(batch, 3, 4, 4, between=(-1.0, 1.0)) * config.varying_gain
        gain = gain + functional.interpolate(
            coarse, (PATCH_SIZE, PATCH_SIZE), mode="bilinear", align_corners=True
        )
    poor = config.poor
    if poor.probability:
        chosen = (rng.uniform(batch, 1, 1, 1) < poor.probability).float()
        gain = gain + chosen * rng.uniform(batch, 3, 1, 1, between=(-1.0, 1.0)) * poor.gain
        albedo = torch.lerp(rendered.albedo, _poor(rendered, poor, rng), chosen)
        rendered = replace(rendered, albedo=albedo)
    return (shade_plain(rendered) * (1 + gain)).clamp(0, 1)


def _poor(rendered: GBuffer, config: PoorTextureConfig, rng: RandomSource) -> Tensor:
    """Albedo (B, 3, H, W) with less detail, contrast and saturation; 0 beside the object."""
    albedo, mask = rendered.albedo, rendered.mask
    batch = len(mask)
    layers = torch.cat([albedo * mask, mask], 1)
    sigma = rng.uniform(batch, between=config.blur)
    blurred = gaussian_blur(layers, sigma)
    smooth = blurred[:, :3] / blurred[:, 3:].clamp_min(
        1e-3
    )  # nothing beside the object is mixed in
    size = mask.sum((2, 3), keepdim=True).clamp_min(1)
    mean = (albedo * mask).sum((2, 3), keepdim=True) / size
    smooth = torch.lerp(mean, smooth, rng.uniform(batch, 1, 1, 1, between=config.contrast))
    grey = smooth.mean(1, keepdim=True)
    smooth = torch.lerp(grey, smooth, rng.uniform(batch, 1, 1, 1, between=config.saturation))
    return smooth.clamp(0, 1) * mask
