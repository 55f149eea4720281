"""Random camera effects: blur, an imperfect lens, resolution, JPEG, colour and noise.

Never knows what the image shows. Most act on a random part of the batch; the operations are those
of `imaging`, and all randomness comes from the random source that is handed in.
"""

from __future__ import annotations

from collections.abc import Callable

import torch
from torch import Tensor
from torch.nn import functional

from ...geometry.crop import PATCH_SIZE
from ..imaging import blur, lens, sensor
from ..imaging.linear_light import to_display
from .config import (
    BlurConfig,
    ColourJitterConfig,
    DownsamplingConfig,
    GaussianBlurConfig,
    JpegConfig,
    LensErrorConfig,
    MotionBlurConfig,
    NoiseConfig,
    ObjectMotionConfig,
    RadialBlurConfig,
    SharpeningConfig,
)
from .random_source import RandomSource

SHARPEST = 0.2  # pixels: standard deviation of the narrowest blur that a kernel can show
BLACK = 1e-4  # of full white: what no pixel falls below
MOVING = 0.5  # pixels: standard deviation of the blur across a motion
RADIUS = 6  # pixels: of the kernels, so that the cost of a blur does not depend on its width
GROUPS = 4  # of a batch at least, each with a resolution of its own
LARGEST_GROUP = 128


def random_blur(image: Tensor, config: BlurConfig, rng: RandomSource) -> Tensor:
    """Defocus and motion blur of a part of the batch."""

    def blurred(part: Tensor) -> Tensor:
        count = len(part)
        sigma = rng.uniform(count, between=config.sigma).clamp_min(SHARPEST)
        length = motion_blur_lengths(count, config.motion, rng)
        length = length * rng.bernoulli(count, config.motion.probability)
        angle = rng.uniform(count, between=(0.0, 3.14159))
        return blur.motion_blur(part, sigma, length, angle, RADIUS)

    return _in_part(image, config.probability, rng, blurred)


def motion_blur_lengths(count: int, config: MotionBlurConfig, rng: RandomSource) -> Tensor:
    """Lengths (count,) of motion blur in pixels of a crop of 128."""
    if config.length_sigma > 0:
        return rng.normal(count).abs() * config.length_sigma * PATCH_SIZE
    return rng.uniform(count, between=config.length)


def random_object_motion(layer: Tensor, config: ObjectMotionConfig, rng: RandomSource) -> Tensor:
    """Premultiplied layers (B, 4, H, W), a part of them blurred by a motion of their own."""
    if not config.probability:
        return layer

    def blurred(part: Tensor) -> Tensor:
        count = len(part)
        length = rng.uniform(count, between=config.length)
        angle = rng.uniform(count, between=(0.0, 3.14159))
        return blur.motion_blur(part, torch.full_like(length, MOVING), length, angle, RADIUS)

    return _in_part(layer, config.probability, rng, blurred)


def random_radial_blur(image: Tensor, config: RadialBlurConfig, rng: RandomSource) -> Tensor:
    """Radial blur of a part of the batch."""
    return _in_part(
        image,
        config.probability,
        rng,
        lambda part: blur.radial_blur(part, rng.normal(len(part)) * config.zoom_sigma),
    )


def random_gaussian_blur(image: Tensor, config: GaussianBlurConfig, rng: RandomSource) -> Tensor:
    """Gaussian blur of a part of the batch."""
    return _in_part(
        image,
        config.probability,
        rng,
        lambda part: blur.gaussian_blur(part, rng.uniform(len(part), between=config.sigma), RADIUS),
    )


def random_lens_error(image: Tensor, config: LensErrorConfig, rng: RandomSource) -> Tensor:
    """Errors of the lens and of the intrinsics in a part of the batch."""

    def displaced(part: Tensor) -> Tensor:
        coefficients = rng.uniform(5, len(part), 1, 1, between=(-1.0, 1.0))
        pixels = rng.uniform(len(part), between=config.displacement)
        return lens.apply_lens_error(part, coefficients, pixels)

    return _in_part(image, config.probability, rng, displaced)


def random_sharpening(image: Tensor, config: SharpeningConfig, rng: RandomSource) -> Tensor:
    """Sharpening of a part of the batch."""
    return _in_part(
        image,
        config.probability,
        rng,
        lambda part: sensor.sharpen(part, rng.uniform(len(part), 1, 1, 1, between=config.amount)),
    )


def random_digitization(
    image: Tensor,
    gamma: Tensor,
    downsampling: DownsamplingConfig,
    jpeg: JpegConfig,
    rng: RandomSource,
    groups: int = GROUPS,
) -> Tensor:
    """Display colours of linear light, perhaps at a lower resolution and after JPEG.

    Pixels of the sensor add up light: that is before the exponents 1 / gamma (B, 1, 1, 1). Each
    group of the batch has one resolution.
    """
    size = image.shape[-1]
    groups = max(groups, -(-len(image) // LARGEST_GROUP))
    parts = []
    for part, exponent in zip(image.chunk(groups), gamma.chunk(groups), strict=True):
        small = part
        if rng.scalar() < downsampling.probability:
            side = round(size * rng.scalar(downsampling.scale))
            small = sensor.resize(part, side, side)
        small = to_display(small.clamp_min(BLACK), exponent)
        if rng.scalar() < jpeg.probability:
            small = sensor.compress_jpeg(small, rng.uniform(len(part), between=jpeg.quality))
        if small.shape[-1] != size:
            small = functional.interpolate(
                small, (size, size), mode="bilinear", align_corners=False
            )
        parts.append(small)
    return torch.cat(parts)


def colour_jitter(image: Tensor, config: ColourJitterConfig, rng: RandomSource) -> Tensor:
    """Exposure, white balance, contrast and saturation."""
    batch = len(image)
    gain = 1 + rng.uniform(batch, 3, 1, 1, between=(-1.0, 1.0)) * config.channel_gain
    gain = gain * rng.uniform(batch, 1, 1, 1, between=config.brightness)
    contrast = rng.uniform(batch, between=config.contrast)
    return sensor.adjust_colour(
        image, gain, contrast, rng.uniform(batch, between=config.saturation)
    )


def random_noise(image: Tensor, config: NoiseConfig, rng: RandomSource) -> Tensor:
    """Gaussian noise of a random strength."""
    if config.sigma[1] <= 0:
        return image
    noise = rng.normal(*image.shape)
    return sensor.add_noise(image, noise, rng.uniform(len(image), 1, 1, 1, between=config.sigma))


def _in_part(
    image: Tensor, probability: float, rng: RandomSource, effect: Callable[[Tensor], Tensor]
) -> Tensor:
    """The images with an effect on a random part of the batch; the given ones stay as they are."""
    chosen = rng.chosen(len(image), probability)
    if not len(chosen):
        return image
    image = image.clone()
    image[chosen] = effect(image[chosen])
    return image
