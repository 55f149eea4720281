"""Deferred shading: light G-buffers by tensor arithmetic, the same for every renderer.

Never casts rays. Five point lights of one colour, metallic and smooth materials, unlit ones too:
paper, section "Data Augmentation Details".
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor

from ...geometry.crop import PADDING

Range = tuple[float, float]

# The paper's seven colours: blue, cyan, green, magenta, red, yellow, white.
LIGHT_COLOURS = (
    (0.0, 0.0, 1.0), (0.0, 1.0, 1.0), (0.0, 1.0, 0.0), (1.0, 0.0, 1.0),
    (1.0, 0.0, 0.0), (1.0, 1.0, 0.0), (1.0, 1.0, 1.0),
)  # fmt: skip


@dataclass(frozen=True)
class LightConfig:
    """Lights and materials; the paper's numbers, and what it leaves open."""

    unlit: float = 0.2  # share of objects without any shading
    lights: int = 5
    intensity: Range = (0.5, 1.5)
    metallic: Range = (0.0, 0.85)
    smoothness: Range = (0.0, 0.8)
    distance: Range = (1.0, 4.0)  # of a light from the object, diameters
    ambient: Range = (0.2, 0.75)  # share of the light that comes from everywhere
    tint: Range = (0.0, 0.35)  # how far from white the lights' colour goes
    ambient_tint: float = 1.0  # how much of that colour the ambient light takes on
    enhanced: Range = (1.0, 1.0)  # brightness of the lights' colour, beside their intensity
    colours: tuple[tuple[float, float, float], ...] = LIGHT_COLOURS


def light(
    albedo: Tensor, normal: Tensor, depth: Tensor, mask: Tensor, distance: Tensor,
    config: LightConfig, generator: torch.Generator,
) -> Tensor:  # fmt: skip
    """Lit pictures (B, 3, H, W), 0 outside the mask; values may exceed 1.

    `albedo`, `normal` (B, 3, H, W) and `mask` (B, 1, H, W) of a look-at G-buffer, `depth`
    (B, 1, H, W) relative to the centre and `distance` (B,), both in diameters. Only the object's
    pixels are computed.
    """
    batch, _, height, width = albedo.shape
    sample, row, column = mask[:, 0].nonzero(as_tuple=True)
    normals = normal[sample, :, row, column]
    rays = _rays(row, column, height, distance[sample])
    points = rays * (depth[sample, 0, row, column] + distance[sample])[:, None]
    points = points - torch.nn.functional.pad(distance[:, None], (2, 0))[sample]
    to_eye = -torch.nn.functional.normalize(rays, dim=-1)
    base = albedo[sample, :, row, column]

    def uniform(*shape: int, between: Range = (0.0, 1.0)) -> Tensor:
        return torch.rand(*shape, generator=generator) * (between[1] - between[0]) + between[0]

    smooth = uniform(batch, between=config.smoothness)[sample]
    metal = uniform(batch, between=config.metallic)[sample][:, None]
    power = 2 ** (10 * smooth * 0.8 + 1)
    diffuse, shine = torch.zeros(len(sample)), torch.zeros(len(sample))
    for _ in range(config.lights):
        place = torch.randn(batch, 3, generator=generator)
        place[:, 2] = -place[:, 2].abs()  # in front of the object, or it would be black
        place = torch.nn.functional.normalize(place, dim=-1)
        place = place * uniform(batch, 1, between=config.distance)
        strength = uniform(batch, between=config.intensity)[sample] / config.lights
        to_light = torch.nn.functional.normalize(place[sample] - points, dim=-1)
        halfway = torch.nn.functional.normalize(to_light + to_eye, dim=-1)
        diffuse += strength * (normals * to_light).sum(-1).clamp_min(0)
        shine += strength * (normals * halfway).sum(-1).clamp_min(0) ** power
    ambient = uniform(batch, between=config.ambient)[sample]
    colours = torch.tensor(config.colours)
    colour = colours[torch.randint(len(colours), (batch,), generator=generator)]
    colour = uniform(batch, 1, between=config.tint) * (colour - 1)
    around = (1 + config.ambient_tint * colour)[sample] * ambient[:, None]
    colour = ((1 + colour) * uniform(batch, 1, between=config.enhanced))[sample]
    lit = around + colour * ((1 - ambient) * 1.6 * diffuse)[:, None]
    gloss = (smooth * shine)[:, None] * (0.4 + 0.6 * metal * base) * colour
    result = base * (1 - 0.3 * metal) * lit + gloss
    plain = (uniform(batch) < config.unlit)[sample][:, None]
    result = torch.where(plain, base, result)
    picture = torch.zeros_like(albedo)
    picture[sample, :, row, column] = result
    return picture


def _rays(row: Tensor, column: Tensor, size: int, distance: Tensor) -> Tensor:
    """Viewing rays (N, 3) with z = 1 of a look-at patch's pixels."""
    focal = size / PADDING * distance
    centre = (size - 1) / 2
    return torch.stack(
        [(column - centre) / focal, (row - centre) / focal, torch.ones_like(focal)], -1
    )
