"""Random lights and materials of training pairs.

Never shades. Five point lights of one colour, metallic and smooth materials, unlit objects too:
paper, section "Data Augmentation Details".
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...geometry.crop import PADDING
from ...typing import Range
from ..imaging.shading import Illumination, Material, ShadedSurface, shade
from .random_source import RandomSource

# The paper's seven colours: blue, cyan, green, magenta, red, yellow, white.
LIGHT_COLOURS = (
    (0.0, 0.0, 1.0), (0.0, 1.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 1.0),
    (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0),
)  # fmt: skip
DIFFUSE = 1.6  # of the lights, so that a surface is about as bright as unlit


@dataclass(frozen=True)
class LightConfig:
    """Lights and materials: the paper's numbers, and what it leaves open.

    Args:
        unlit_probability: of an object without any shading.
        count: of point lights.
        intensity: of each light.
        metallic: of the material, 0 to 1.
        smoothness: of the material, 0 to 1.
        distance: of a light from the object, in diameters.
        ambient: share of the light that comes from everywhere.
        tint: how far from white the lights' colour goes.
        ambient_tint: how much of that colour the ambient light takes on.
        colour_gain: brightness of the lights' colour, beside their intensity.
        colours: one of which all lights of an object have, RGB.
    """

    unlit_probability: float = 0.2
    count: int = 5
    intensity: Range = (0.5, 1.5)
    metallic: Range = (0.0, 0.85)
    smoothness: Range = (0.0, 0.8)
    distance: Range = (1.0, 4.0)
    ambient: Range = (0.2, 0.75)
    tint: Range = (0.0, 0.35)
    ambient_tint: float = 1.0
    colour_gain: Range = (1.0, 1.0)
    colours: tuple[tuple[float, float, float], ...] = LIGHT_COLOURS


def random_lighting(
    albedo: Tensor, normal: Tensor, depth: Tensor, mask: Tensor, distance: Tensor,
    config: LightConfig, rng: RandomSource,
) -> Tensor:  # fmt: skip
    """Shaded crops (B, 3, H, W), 0 outside the mask; values may exceed 1.

    `albedo`, `normal` (B, 3, H, W) and `mask` (B, 1, H, W) of a look-at G-buffer, `depth`
    (B, 1, H, W) relative to the centre and `distance` (B,), both in diameters.
    """
    surface = ShadedSurface.of(
        albedo,
        normal,
        depth + distance[:, None, None, None],
        mask,
        crop_intrinsics(albedo.shape[-2], distance),
        torch.nn.functional.pad(distance[:, None], (2, 0)),
    )
    light, material = draw_lighting(len(albedo), config, rng)
    colour = shade(surface, light, material)
    unlit = rng.bernoulli(len(albedo), config.unlit_probability)
    return surface.image(torch.where(unlit[surface.view][:, None], surface.albedo, colour))


def draw_lighting(
    batch: int, config: LightConfig, rng: RandomSource
) -> tuple[Illumination, Material]:
    """Lights, in diameters about the object, and materials of B crops."""
    smoothness = rng.uniform(batch, between=config.smoothness)
    metallic = rng.uniform(batch, between=config.metallic)
    positions, strengths = [], []
    for _ in range(config.count):
        place = rng.normal(batch, 3)
        place[:, 2] = -place[:, 2].abs()  # in front of the object, or it would be black
        place = torch.nn.functional.normalize(place, dim=-1)
        place = place * rng.uniform(batch, 1, between=config.distance)
        positions.append(torch.nn.functional.pad(place, (0, 1), value=1.0))
        strengths.append(rng.uniform(batch, between=config.intensity) / config.count)
    ambient = rng.uniform(batch, between=config.ambient)
    colours = torch.tensor(config.colours, device=rng.device)
    chosen = rng.integers(batch, below=len(colours))
    tint = rng.uniform(batch, 1, between=config.tint) * (colours[chosen] - 1)
    light = Illumination(
        torch.stack(positions),
        torch.stack(strengths),
        (1 + tint) * rng.uniform(batch, 1, between=config.colour_gain),
        (1 - ambient) * DIFFUSE,
        (1 + config.ambient_tint * tint) * ambient[:, None],
    )
    return light, Material(metallic, smoothness)


def crop_intrinsics(size: int, distance: Tensor) -> Tensor:
    """Intrinsics (B, 3, 3) of look-at crops of objects at a distance (B,) in diameters."""
    matrix = distance.new_zeros(len(distance), 3, 3)
    matrix[:, 0, 0] = matrix[:, 1, 1] = size / PADDING * distance
    matrix[:, :2, 2] = (size - 1) / 2
    matrix[:, 2, 2] = 1
    return matrix
