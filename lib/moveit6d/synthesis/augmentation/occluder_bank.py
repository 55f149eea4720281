"""The paper's bank of occluders: rendered crops of random objects, cut and made smaller.

Never pastes. Paper, "Data Augmentation Details": 20k rendered crops, of which four are drawn for
a training picture. The bank fills up as training goes, so that a fit begins at once; a full one
costs nothing any more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ...geometry.crop import PATCH_SIZE
from ...geometry.pose import Pose
from ...geometry.rotation import random_rotations
from ...typing import Range
from ..imaging.layers import premultiplied
from ..imaging.sensor import resize, to_bytes
from ..objects.object_set import ObjectSet
from .lights import LightConfig, crop_intrinsics, random_lighting
from .random_source import RandomSource


@dataclass(frozen=True)
class BankConfig:
    """Rendered occluders that are kept.

    Args:
        size: how many; 0: no bank.
        new_per_batch: rendered with each batch until the bank is full.
        crop_size: height and width that are cut out of a rendered crop of 128 pixels.
        resized_to: height and width to which the cut is resized.
    """

    size: int = 0
    new_per_batch: int = 16
    crop_size: Range = (96.0, 128.0)
    resized_to: Range = (32.0, 64.0)


class OccluderBank:
    """Layers (4, h, w) of shaded objects, colour × alpha and alpha, drawn at random."""

    def __init__(
        self, objects: ObjectSet, config: BankConfig, lights: LightConfig, distance: Range,
        rng: RandomSource, random: np.random.Generator,
    ) -> None:  # fmt: skip
        self.objects, self.config, self.random = objects, config, random
        self.lights, self.distance, self.rng = lights, distance, rng
        side = int(config.resized_to[1])
        # Pages of memory that nothing has been written to cost nothing.
        self.patches = torch.empty(config.size, 4, side, side, dtype=torch.uint8, device=rng.device)
        self.filled = 0

    def grow(self) -> None:
        """Render new layers unless the bank is full."""
        count = min(self.config.new_per_batch, self.config.size - self.filled)
        if count > 0:
            self.patches[self.filled : self.filled + count] = self._render(count)
            self.filled += count

    def draw(self, count: int) -> Tensor:
        """Random layers in the middle of empty crops: (count, 4, 128, 128)."""
        index = self.rng.integers(count, below=self.filled)
        margin = PATCH_SIZE - self.patches.shape[-1]
        before = margin // 2
        sides = (before, margin - before, before, margin - before)
        return functional.pad(self.patches[index].float() / 255, sides)

    def _render(self, count: int) -> Tensor:
        side = self.patches.shape[-1]
        layers = random_layers(
            count, self.objects, self.distance, self.lights, self.rng, self.random
        )
        result = torch.zeros(count, 4, side, side, device=self.rng.device)
        for number, layer in enumerate(layers):
            cut = self._cut(layer)
            top, left = (side - cut.shape[-2]) // 2, (side - cut.shape[-1]) // 2
            result[number, :, top : top + cut.shape[-2], left : left + cut.shape[-1]] = cut
        return to_bytes(result)

    def _cut(self, layer: Tensor) -> Tensor:
        """A random part of a layer (4, 128, 128), made smaller: (4, h, w)."""
        high, wide = self.rng.uniform(2, between=self.config.crop_size).round().int().tolist()
        small = self.rng.uniform(2, between=self.config.resized_to).round().int().tolist()
        top, left = (
            int(self.rng.uniform(1).item() * (PATCH_SIZE - extent + 1)) for extent in (high, wide)
        )
        return resize(layer[None, :, top : top + high, left : left + wide], *small)[0]


def random_layers(
    count: int, objects: ObjectSet, distances: Range, lights: LightConfig, rng: RandomSource,
    random: np.random.Generator,
) -> Tensor:  # fmt: skip
    """Shaded objects in random rotations, as `lit_layers`: (count, 4, 128, 128).

    Their `distances` in diameters are log-uniform.
    """
    index = objects.draw(random, count)
    low, high = np.log(distances)
    distance = torch.exp(rng.uniform(count, between=(low, high))).double()
    ahead = functional.pad((distance * objects.diameters(index))[:, None], (2, 0))
    poses = Pose(random_rotations(count, rng.generator), ahead)
    return lit_layers(objects, index, poses, distance, lights, rng)


def lit_layers(
    objects: ObjectSet, index: Tensor, poses: Pose, distance: Tensor, lights: LightConfig,
    rng: RandomSource,
) -> Tensor:  # fmt: skip
    """Shaded objects (B,) in look-at crops: (B, 4, 128, 128), colour × mask and mask.

    `distance` (B,) sets the focal length as that of an object so many diameters away.
    """
    seen = objects.render(index, poses, crop_intrinsics(PATCH_SIZE, distance))
    # The unit in which the object's centre is `distance` away: lights are placed in it.
    unit = (poses.translation[:, 2] / distance).float()[:, None, None, None]
    near = distance.float()
    depth = (seen.depth / unit - near[:, None, None, None]) * seen.mask
    lit = random_lighting(seen.albedo, seen.normal, depth, seen.mask, near, lights, rng)
    return premultiplied(lit, seen.mask)
