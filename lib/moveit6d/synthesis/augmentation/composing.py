"""Puts an observed patch together: photo, clutter, the lit object, occluders, the camera.

Never renders the object itself. The same steps make the paper's pictures and the realistic ones;
which of them happen, how often and how much is `AugmentConfig`, `HandConfig` and `BankConfig`.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ...geometry.crop import PATCH_SIZE
from ...geometry.mesh import Mesh
from ...rendering.renderer import GBuffer, Renderer
from .augment import (
    AugmentConfig,
    RandomSource,
    calibration_boards,
    crop_region,
    cut_border,
    loose,
    loose_things,
    occlude,
    over,
    rounds,
    scatter,
    shadow,
)
from .hands import HandConfig, Hands
from .lens_effects import (
    blur,
    defocus_background,
    degrade,
    perturb_lens,
    radial_blur,
    recolour,
    sharpen,
)
from .lighting import LightConfig, light
from .occluder_bank import BankConfig, OccluderBank
from .photos import random_square


class Composer:
    """Makes observed patches of what is rendered; its occluders are made as it goes."""

    def __init__(
        self, photos: Sequence[np.ndarray], augment: AugmentConfig, lights: LightConfig,
        random: np.random.Generator, rng: RandomSource,
    ) -> None:  # fmt: skip
        self.photos, self.augment, self.lights = list(photos), augment, lights
        self.random, self.rng = random, rng
        self.bank: OccluderBank | None = None
        self.hands: Hands | None = None

    def use_bank(
        self, config: BankConfig, meshes: Sequence[Mesh], renderer: Renderer,
        distance: tuple[float, float],
    ) -> None:  # fmt: skip
        """Take occluders from a bank of these meshes' patches; of size 0, from none."""
        if config.size > 0:
            self.bank = OccluderBank(meshes, config, renderer, self.lights, distance, self.rng)

    def use_hands(self, config: HandConfig, renderer: Renderer) -> None:
        """Put hands and cards in front as well."""
        if config.share > 0:
            parts = (renderer, self.lights, self.random, self.rng)
            self.hands = Hands(config, self.photos, *parts)

    def picture(self, observed: GBuffer, depth: Tensor, distance: Tensor) -> tuple[Tensor, Tensor]:
        """Observed patches (B, 3, 128, 128), and 1 where nothing would occlude the object.

        `depth` (B, 1, 128, 128) is relative to the look-at view's centre and `distance` (B,) that
        centre's, in diameters.
        """
        augment, rng, batch = self.augment, self.rng, len(distance)
        lit = light(
            observed.albedo, observed.normal, depth, observed.mask, distance,
            self.lights, rng.generator,
        )  # fmt: skip
        layer = torch.cat([lit * observed.mask, observed.mask], 1)
        background = defocus_background(self._photos(batch), augment, rng)
        background = self._cluttered(background, layer)
        picture = over(background, self._imaged_layer(soft_edge(layer)))
        picture, occlusion = occlude(picture, self._things(layer), augment, rng)
        if self.hands is not None:
            chosen, fronts = self.hands.draw(batch, distance)
            picture[chosen] = over(picture[chosen], soft_edge(fronts))
            occlusion[chosen] = torch.maximum(occlusion[chosen], fronts[:, 3:])
        picture, occlusion = crop_region(background, picture, occlusion, augment, rng)
        picture, border = cut_border(self._taken(picture).clamp(0, 1), augment, rng)
        return (picture * 255).round() / 255, (occlusion < 0.5) * (1 - border)

    def _taken(self, picture: Tensor) -> Tensor:
        """The picture as the camera takes it."""
        augment, rng, whole = self.augment, self.rng, self.augment.acts_on == "picture"
        picture = shadow(picture, augment, rng)
        if whole:
            picture = radial_blur(blur(picture, augment, rng), augment, rng)
        picture = perturb_lens(picture, augment, rng)
        picture = degrade(picture, augment, rng)
        picture = sharpen(picture, augment, rng)
        return recolour(picture, augment, rng) if whole else picture

    def _imaged_layer(self, layer: Tensor) -> Tensor:
        """Blur and colour of one layer alone, if that is what they act on."""
        if self.augment.acts_on == "picture":
            return layer
        layer = radial_blur(blur(layer, self.augment, self.rng), self.augment, self.rng)
        colour, alpha = loose(layer)
        colour = recolour(colour, self.augment, self.rng).clamp(0, 1)
        return torch.cat([colour * alpha, alpha], 1)

    def _cluttered(self, background: Tensor, layer: Tensor) -> Tensor:
        """Photos (B, 3, N, N) with boards and other objects of the batch in a part of them."""
        augment, rng, batch = self.augment, self.rng, len(background)
        background = background.clone()
        with_board = rng.chance(batch, augment.boards).nonzero()[:, 0]
        if len(with_board):
            background[with_board] = over(
                background[with_board],
                calibration_boards(len(with_board), background.shape[-1], rng),
            )
        several = rounds(batch, augment.cluttered, augment.clutter, rng)
        for layers, behind in enumerate(several):
            same_colour = rng.chance(len(behind), augment.same_colour_distractors) & (layers == 0)
            other = torch.where(same_colour, behind, rng.permutation(batch)[: len(behind)])
            placed = scatter(layer[other], rng.uniform(len(behind), between=(0.4, 1.1)), 1.0, rng)
            background[behind] = over(background[behind], placed)
        return background

    def _things(self, layer: Tensor) -> Callable[[Tensor], Tensor]:
        """Where occluders come from."""
        bank = self.bank
        if bank is None:
            return loose_things(layer, self._photos(len(layer)), self.augment, self.rng)
        bank.grow()
        return lambda chosen: self._imaged_layer(bank.draw(len(chosen)))

    def _photos(self, count: int) -> Tensor:
        squares = [random_square(self.photos, self.random, PATCH_SIZE) for _ in range(count)]
        return torch.from_numpy(np.stack(squares)).permute(0, 3, 1, 2).float() / 255


def soft_edge(layer: Tensor) -> Tensor:
    """A layer (B, 4, H, W) with an edge about a pixel wide, as a camera's pixels would show it."""
    padded = functional.pad(layer, (1, 1, 1, 1))
    # The kernel 1 2 1 along both axes; in place, as memory is what this costs.
    rows = (padded[..., :-2] + padded[..., 2:]).add_(padded[..., 1:-1], alpha=2)
    spread = (rows[..., :-2, :] + rows[..., 2:, :]).add_(rows[..., 1:-1, :], alpha=2).mul_(1 / 16)
    alpha = spread[:, 3:]
    colour = torch.where(layer[:, 3:] > 0.5, layer[:, :3] * alpha, spread[:, :3])
    return torch.cat([colour, alpha], 1)
