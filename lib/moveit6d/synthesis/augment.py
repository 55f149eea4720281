"""What happens between an object and a picture of it: occluders, blur, resolution, colour, noise.

Never renders. Batched tensor arithmetic through kornia; all randomness comes from the generator
that is handed in.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from kornia.enhance import (
    adjust_contrast_with_mean_subtraction,
    adjust_saturation_with_gray_subtraction,
    jpeg_codec_differentiable,
)
from kornia.filters import filter2d
from kornia.geometry.transform import warp_affine
from torch import Tensor
from torch.nn import functional

Range = tuple[float, float]


@dataclass(frozen=True)
class AugmentConfig:
    """Shares and ranges of what disturbs the observed patch; sizes in patch pixels."""

    occluded: float = 0.55  # share of patches with anything in front of the object
    occluders: int = 3  # at most
    occluder_scale: Range = (0.2, 0.75)  # of the patch
    photo_occluder: float = 0.45  # share of occluders cut from photos instead of other objects
    cluttered: float = 0.5  # share with another object behind
    blurred: float = 0.5
    defocus: Range = (0.2, 1.4)  # standard deviation
    motion: Range = (0.0, 9.0)  # length of the smear
    coarse: float = 0.4  # share seen at a lower resolution
    resolution: Range = (0.4, 0.95)  # of the patch's own
    jpeg: float = 0.35
    jpeg_quality: Range = (35.0, 92.0)
    brightness: Range = (0.7, 1.3)
    contrast: Range = (0.75, 1.3)
    saturation: Range = (0.5, 1.35)
    channel_gain: float = 0.1
    noise: Range = (0.0, 0.025)
    border: float = 0.1  # share that reaches beyond the image: a black side


class Dice:
    """Random numbers of one generator in the forms that augmentation needs."""

    def __init__(self, generator: torch.Generator) -> None:
        self.generator = generator

    def uniform(self, *shape: int, between: Range = (0.0, 1.0)) -> Tensor:
        """Uniform numbers of the given shape."""
        values = torch.rand(*shape, generator=self.generator)
        return values * (between[1] - between[0]) + between[0]

    def normal(self, *shape: int) -> Tensor:
        """Normal numbers of the given shape."""
        return torch.randn(*shape, generator=self.generator)

    def chance(self, count: int, share: float) -> Tensor:
        """Which of `count` it happens to: bool (count,)."""
        return self.uniform(count) < share

    def permutation(self, count: int) -> Tensor:
        """A random order of `count` things."""
        return torch.randperm(count, generator=self.generator)


def paste(picture: Tensor, layer: Tensor, alpha: Tensor) -> Tensor:
    """Layer over picture: (B, 3, H, W) each, alpha (B, 1, H, W) in [0, 1]."""
    return picture + (layer - picture) * alpha


def scatter(layers: Tensor, scale: Tensor, spread: float, dice: Dice) -> Tensor:
    """Layers (B, C, N, N), shrunk by `scale` (B,), turned and put somewhere in the patch."""
    batch, size = len(layers), layers.shape[-1]
    angle = dice.uniform(batch, between=(-3.14159, 3.14159))
    place = (dice.uniform(batch, 2, between=(-0.5, 0.5)) * spread + 0.5) * size
    cosine, sine = angle.cos() * scale, angle.sin() * scale
    matrix = torch.stack([cosine, -sine, sine, cosine], -1).reshape(batch, 2, 2)
    middle = layers.new_full((2,), size / 2)
    shift = place - (matrix @ middle[:, None])[..., 0]
    affine = torch.cat([matrix, shift[..., None]], -1)
    warped: Tensor = warp_affine(layers, affine, (size, size), align_corners=False)
    return warped


def cutout_masks(count: int, size: int, dice: Dice) -> Tensor:
    """Shapes of things cut from photos, (count, 1, size, size) 0/1: cards, bars and blobs."""
    line = torch.linspace(-1, 1, size)
    y, x = torch.meshgrid(line, line, indexing="ij")
    wide, high = dice.uniform(2, count, 1, 1, between=(0.25, 1.0))
    card = (x.abs() < wide) & (y.abs() < high)
    coarse = dice.normal(count, 1, 6, 6)
    blob = functional.interpolate(coarse, (size, size), mode="bicubic", align_corners=False)[:, 0]
    is_blob = dice.chance(count, 0.5)[:, None, None]
    return torch.where(is_blob, blob > 0.1, card).float()[:, None]


def occlude(
    picture: Tensor, objects: Tensor, photos: Tensor, config: AugmentConfig, dice: Dice
) -> tuple[Tensor, Tensor]:
    """Put things in front: the picture (B, 3, N, N) and what they cover, alpha (B, 1, N, N).

    `objects` (B, 4, N, N) are lit objects (0 outside) with their mask, `photos` (B, 3, N, N) are
    cut up.
    """
    batch, size = len(picture), picture.shape[-1]
    covered = torch.zeros_like(picture[:, :1])
    number = torch.randint(1, config.occluders + 1, (batch,), generator=dice.generator)
    number = number * dice.chance(batch, config.occluded)
    for layer in range(config.occluders):
        shape = cutout_masks(batch, size, dice)
        cut = torch.cat([photos * shape, shape], 1)[dice.permutation(batch)]
        from_photo = dice.chance(batch, config.photo_occluder)[:, None, None, None]
        things = torch.where(from_photo, cut, objects[dice.permutation(batch)])
        chosen = (number > layer).nonzero()[:, 0]
        if not len(chosen):
            break
        scale = dice.uniform(len(chosen), between=config.occluder_scale)
        placed = scatter(things[chosen], scale, 1.0, dice)
        alpha = placed[:, 3:]
        picture[chosen] = paste(picture[chosen], placed[:, :3] / alpha.clamp_min(1e-3), alpha)
        covered[chosen] = torch.maximum(covered[chosen], alpha)
    return picture, covered


def blur(picture: Tensor, config: AugmentConfig, dice: Dice) -> Tensor:
    """Defocus and motion blur of a part of the batch by one oriented Gaussian each."""
    chosen = dice.chance(len(picture), config.blurred).nonzero()[:, 0]
    if not len(chosen):
        return picture
    count = len(chosen)
    defocus = dice.uniform(count, between=config.defocus)
    # A smear of length L has the variance L² / 12; half of the blurred patches have none.
    smear = dice.uniform(count, between=config.motion) * dice.chance(count, 0.5)
    angle = dice.uniform(count, between=(0.0, 3.14159))
    along, across = (defocus**2 + smear**2 / 12)[:, None, None], (defocus**2)[:, None, None]
    line = torch.arange(-4, 5).float()
    y, x = torch.meshgrid(line, line, indexing="ij")
    cosine, sine = angle.cos()[:, None, None], angle.sin()[:, None, None]
    forward, aside = x * cosine + y * sine, y * cosine - x * sine
    kernel = torch.exp(-0.5 * (forward**2 / along + aside**2 / across))
    picture = picture.clone()
    picture[chosen] = filter2d(picture[chosen], kernel, normalized=True, border_type="replicate")
    return picture


def degrade(picture: Tensor, config: AugmentConfig, dice: Dice, groups: int = 4) -> Tensor:
    """Lower resolution and JPEG blocks, one setting a group of the batch."""
    size = picture.shape[-1]
    parts = []
    for part in picture.chunk(groups):
        small = part
        if dice.uniform(1).item() < config.coarse:
            side = round(size * dice.uniform(1, between=config.resolution).item())
            small = functional.interpolate(
                part, (side, side), mode="bilinear", antialias=True, align_corners=False
            )
        if dice.uniform(1).item() < config.jpeg:
            quality = dice.uniform(len(part), between=config.jpeg_quality)
            small = jpeg_codec_differentiable(small.clamp(0, 1), quality)
        if small.shape[-1] != size:
            small = functional.interpolate(
                small, (size, size), mode="bilinear", align_corners=False
            )
        parts.append(small)
    return torch.cat(parts)


def recolour(picture: Tensor, config: AugmentConfig, dice: Dice) -> Tensor:
    """Exposure, contrast, saturation, white balance and sensor noise."""
    batch = len(picture)
    gain = 1 + dice.uniform(batch, 3, 1, 1, between=(-1.0, 1.0)) * config.channel_gain
    picture = picture * gain * dice.uniform(batch, 1, 1, 1, between=config.brightness)
    picture = adjust_contrast_with_mean_subtraction(
        picture, dice.uniform(batch, between=config.contrast)
    )
    picture = adjust_saturation_with_gray_subtraction(
        picture, dice.uniform(batch, between=config.saturation)
    )
    noise = dice.normal(*picture.shape)
    return picture + noise * dice.uniform(batch, 1, 1, 1, between=config.noise)


def cut_border(picture: Tensor, config: AugmentConfig, dice: Dice) -> tuple[Tensor, Tensor]:
    """Black sides where the patch reaches beyond the image: the picture and the border mask."""
    batch, size = len(picture), picture.shape[-1]
    width = dice.uniform(batch, between=(0.05, 0.45)) * size * dice.chance(batch, config.border)
    line = torch.arange(size).float()
    outside = (line[None] < width[:, None]).float()
    flip = dice.chance(batch, 0.5)[:, None]
    outside = torch.where(flip, outside.flip(-1), outside)
    vertical = dice.chance(batch, 0.5)[:, None, None, None]
    border = torch.where(vertical, outside[:, None, :, None], outside[:, None, None, :])
    border = border.expand(batch, 1, size, size)
    return picture * (1 - border), border
