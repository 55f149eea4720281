"""Deferred shading: G-buffers under lights by tensor arithmetic, the same for every renderer.

Never casts rays and never draws a random number. The Blinn-Phong model with metallic and smooth
materials; only the object's pixels are computed.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn.functional import normalize

METALLIC_LOSS = 0.3  # of the diffuse reflection, for a fully metallic surface


@dataclass(frozen=True)
class ShadedSurface:
    """The object's pixels (N,) in B views, one after another; points are relative to its centre.

    Made of linear or of display colours; the shaded ones are then of the same kind.
    """

    view: Tensor  # (N,) number of the view
    row: Tensor  # (N,)
    column: Tensor  # (N,)
    albedo: Tensor  # (N, 3)
    normal: Tensor  # (N, 3) unit, camera frame
    ray: Tensor  # (N, 3) from the camera, z = 1
    point: Tensor  # (N, 3) camera frame, origin in the object's centre
    shape: tuple[int, int, int]  # B, H, W

    @staticmethod
    def of(
        albedo: Tensor, normal: Tensor, depth: Tensor, mask: Tensor, intrinsics: Tensor,
        centre: Tensor,
    ) -> ShadedSurface:  # fmt: skip
        """The pixels in the `mask` (B, 1, H, W) of a G-buffer.

        `albedo` and `normal` are (B, 3, H, W), `depth` (B, 1, H, W) along the camera's axis,
        `intrinsics` (B, 3, 3) without skew and `centre` (B, 3) the object's in the camera frame;
        depth and centre in the unit in which lights are placed.
        """
        view, row, column = mask[:, 0].nonzero(as_tuple=True)
        matrix = intrinsics[view]
        ray = torch.stack(
            [
                (column - matrix[:, 0, 2]) / matrix[:, 0, 0],
                (row - matrix[:, 1, 2]) / matrix[:, 1, 1],
                torch.ones_like(matrix[:, 0, 0]),
            ],
            -1,
        )
        point = ray * depth[view, 0, row, column][:, None] - centre[view]
        return ShadedSurface(
            view, row, column, albedo[view, :, row, column], normal[view, :, row, column], ray,
            point, (len(mask), *mask.shape[2:]),
        )  # fmt: skip

    def image(self, colour: Tensor) -> Tensor:
        """Values (N, C) of the pixels as images (B, C, H, W), 0 elsewhere."""
        batch, height, width = self.shape
        image = colour.new_zeros(batch, colour.shape[1], height, width)
        image[self.view, :, self.row, self.column] = colour
        return image


@dataclass(frozen=True)
class Illumination:
    """L lights of one colour and ambient light, in each of B views.

    Args:
        position: (L, B, 4) homogeneous, about the object's centre: of a light far away, the
            direction towards it and 0.
        strength: (L, B) factor of each light.
        colour: (B, 3) of the lights.
        diffuse: (B,) factor of what is reflected diffusely.
        ambient: (B, 3) light that comes from everywhere.
        hemisphere: how much darker ambient light is from below than from above (camera frame).
    """

    position: Tensor
    strength: Tensor
    colour: Tensor
    diffuse: Tensor
    ambient: Tensor
    hemisphere: float = 0.0


@dataclass(frozen=True)
class Material:
    """How surfaces reflect, one value a view (B,), each in [0, 1].

    Args:
        metallic: how much of the highlight takes on the surface's colour.
        smoothness: strength and sharpness of the highlight.
    """

    metallic: Tensor
    smoothness: Tensor


def shade(
    surface: ShadedSurface,
    light: Illumination,
    material: Material,
    visibility: Tensor | None = None,
) -> Tensor:
    """Colours (N, 3) of the surface's pixels; values may exceed 1.

    `visibility` (N,) in [0, 1] says how much of the lights reaches each pixel; all of it if None.
    """
    view, base, normal = surface.view, surface.albedo, surface.normal
    smooth = material.smoothness[view]
    metal = material.metallic[view][:, None]
    power: Tensor = 2 ** (10 * smooth * 0.8 + 1)
    to_eye = -normalize(surface.ray, dim=-1)
    diffuse, specular = torch.zeros(2, len(view), device=base.device)
    for position, factor in zip(light.position, light.strength, strict=True):
        place, strength = position[view], factor[view]
        to_light = normalize(place[:, :3] - place[:, 3:] * surface.point, dim=-1)
        halfway = normalize(to_light + to_eye, dim=-1)
        diffuse += strength * (normal * to_light).sum(-1).clamp_min(0)
        specular += strength * (normal * halfway).sum(-1).clamp_min(0) ** power
    if visibility is not None:
        diffuse, specular = diffuse * visibility, specular * visibility
    ambient, colour = light.ambient[view], light.colour[view]
    if light.hemisphere:  # y points down
        ambient = ambient * (1 - 0.5 * light.hemisphere * (1 + normal[:, 1:2]))
    lit = ambient + colour * (light.diffuse[view] * diffuse)[:, None]
    gloss = (smooth * specular)[:, None] * (0.4 + 0.6 * metal * base) * colour
    colours: Tensor = base * (1 - METALLIC_LOSS * metal) * lit + gloss
    return colours
