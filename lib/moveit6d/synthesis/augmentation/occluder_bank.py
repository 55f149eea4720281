"""The paper's bank of occluders: rendered patches of random objects, cut and made smaller.

Never pastes. Paper, "Data Augmentation Details": 20k rendered patches, of which four are drawn for
a training picture. The bank fills up as training goes, so that a fit begins at once; a full one
costs nothing any more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ...geometry.crop import OBJECT_SIZE, PATCH_SIZE
from ...geometry.mesh import Mesh, sphere_diameters
from ...geometry.pose import Pose
from ...geometry.rotation import random_rotations
from ...rendering.renderer import Renderer
from .augment import RandomSource
from .lighting import LightConfig, light

Range = tuple[float, float]


@dataclass(frozen=True)
class BankConfig:
    """How many patches there are and how they are cut; 0 patches: no bank."""

    size: int = 0
    each_batch: int = 16  # new patches a batch until the bank is full
    crop: Range = (96.0, 128.0)  # height and width cut out of a rendered patch of 128
    resized: Range = (32.0, 64.0)  # height and width that the cut is made


class OccluderBank:
    """Patches (4, h, w) of lit objects, colour × alpha and alpha, drawn at random."""

    def __init__(
        self, meshes: Sequence[Mesh], config: BankConfig, renderer: Renderer,
        lights: LightConfig, distance: Range, rng: RandomSource,
    ) -> None:  # fmt: skip
        self.meshes, self.config, self.renderer = meshes, config, renderer
        self.lights, self.distance, self.rng = lights, distance, rng
        side = int(config.resized[1])
        # Pages of memory that nothing has been written to cost nothing.
        self.patches = torch.empty(config.size, 4, side, side, dtype=torch.uint8)
        self.filled = 0

    def grow(self) -> None:
        """Render new patches unless the bank is full."""
        count = min(self.config.each_batch, self.config.size - self.filled)
        if count > 0:
            self.patches[self.filled : self.filled + count] = self._render(count)
            self.filled += count

    def draw(self, count: int) -> Tensor:
        """Random patches in the middle of empty ones of full size: (count, 4, 128, 128)."""
        index = torch.randint(self.filled, (count,), generator=self.rng.generator)
        margin = PATCH_SIZE - self.patches.shape[-1]
        before = margin // 2
        sides = (before, margin - before, before, margin - before)
        return functional.pad(self.patches[index].float() / 255, sides)

    def _render(self, count: int) -> Tensor:
        rng, side = self.rng, self.patches.shape[-1]
        which = torch.randint(len(self.meshes), (count,), generator=rng.generator)
        meshes = [self.meshes[int(k)] for k in which]
        low, high = np.log(self.distance)
        distance = torch.exp(rng.uniform(count, between=(low, high))).double()
        diameter = sphere_diameters(meshes)
        ahead = torch.zeros(count, 3, dtype=torch.float64)
        ahead[:, 2] = distance * diameter
        poses = Pose(random_rotations(count, rng.generator), ahead)
        layers = lit_layers(self.renderer, meshes, poses, distance, self.lights, rng)
        result = torch.zeros(count, 4, side, side)
        for number, layer in enumerate(layers):
            cut = self._cut(layer)
            top, left = (side - cut.shape[-2]) // 2, (side - cut.shape[-1]) // 2
            result[number, :, top : top + cut.shape[-2], left : left + cut.shape[-1]] = cut
        return (result.clamp(0, 1) * 255).round().byte()

    def _cut(self, layer: Tensor) -> Tensor:
        """A random part of a layer (4, 128, 128), made smaller: (4, h, w)."""
        high, wide = self.rng.uniform(2, between=self.config.crop).round().int().tolist()
        small = self.rng.uniform(2, between=self.config.resized).round().int().tolist()
        top, left = (
            int(self.rng.uniform(1).item() * (PATCH_SIZE - extent + 1)) for extent in (high, wide)
        )
        part = layer[None, :, top : top + high, left : left + wide]
        return functional.interpolate(
            part, small, mode="bilinear", antialias=True, align_corners=False
        )[0]


def lit_layers(
    renderer: Renderer, meshes: Sequence[Mesh], poses: Pose, distance: Tensor,
    lights: LightConfig, rng: RandomSource,
) -> Tensor:  # fmt: skip
    """Meshes seen in look-at patches, lit: (B, 4, 128, 128), colour × mask and mask.

    `distance` (B,) sets the focal length as that of an object so many diameters away.
    """
    focal = OBJECT_SIZE * distance
    seen = renderer.render(list(meshes), poses, _patch_intrinsics(focal))
    # The unit in which the middle of the patch is `distance` away: what `light` measures in.
    unit = (poses.translation[:, 2] / distance).float()[:, None, None, None]
    near = distance.float()
    depth = (seen.depth / unit - near[:, None, None, None]) * seen.mask
    lit = light(seen.albedo, seen.normal, depth, seen.mask, near, lights, rng.generator)
    return torch.cat([lit * seen.mask, seen.mask], 1)


def _patch_intrinsics(focal: Tensor) -> Tensor:
    """Intrinsics (B, 3, 3) of look-at patches by their focal lengths (B,) in pixels."""
    matrix = torch.zeros(len(focal), 3, 3, dtype=torch.float64)
    matrix[:, 0, 0] = matrix[:, 1, 1] = focal
    matrix[:, 0, 2] = matrix[:, 1, 2] = (PATCH_SIZE - 1) / 2
    matrix[:, 2, 2] = 1
    return matrix
