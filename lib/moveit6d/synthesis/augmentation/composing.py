"""Puts an observed patch together: photo, clutter, the lit object, what covers it, the camera.

Never renders the object itself. The same steps make the paper's pictures and the realistic ones;
which of them happen, how often and how much is `AugmentConfig`, `HandConfig` and `BankConfig`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ..geometry.crop import PATCH_SIZE
from ..rendering.renderer import GBuffer
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
from .hands import HandConfig, Hands, HandSource
from .lens_effects import bend, blur, defocus_background, degrade, radial_blur, recolour, sharpen
from .lighting import LightConfig, light
from .object_set import ObjectSet
from .occluder_bank import BankConfig, OccluderBank
from .photo_bank import PhotoBank


class Composer:
    """Makes observed patches of what is rendered; its occluders are made as it goes.

    What reaches a pixel from several things, at an edge or in a blur, adds up as light does: colours
    are made linear first (`AugmentConfig.gamma`), and a bright thing before a dark one looks larger.
    """

    def __init__(
        self, photos: PhotoBank, augment: AugmentConfig, lights: LightConfig, dice: Dice
    ) -> None:
        self.photos, self.augment, self.lights, self.dice = photos, augment, lights, dice
        self.bank: OccluderBank | None = None
        self.hands: Hands | None = None

    def use_bank(
        self, config: BankConfig, objects: ObjectSet, distance: tuple[float, float],
        random: np.random.Generator,
    ) -> None:  # fmt: skip
        """Take occluders from a bank of these objects' patches; of size 0, from none."""
        if config.size > 0:
            self.bank = OccluderBank(objects, config, self.lights, distance, self.dice, random)

    def use_hands(
        self, config: HandConfig, source: HandSource, random: np.random.Generator
    ) -> None:
        """Put hands and cards in front as well."""
        self.hands = Hands(config, source, self.lights, random, self.dice)

    def picture(self, observed: GBuffer, depth: Tensor, distance: Tensor) -> tuple[Tensor, Tensor]:
        """Observed patches (B, 3, 128, 128), and 1 where nothing would cover the object.

        `depth` (B, 1, 128, 128) is relative to the look-at view's centre and `distance` (B,) that
        centre's, in diameters.
        """
        augment, rng, batch = self.augment, self.rng, len(distance)
        lit = light(
            observed.albedo, observed.normal, depth, observed.mask, distance,
            self.lights, rng.generator,
        )  # fmt: skip
        gamma = dice.uniform(batch, 1, 1, 1, between=augment.gamma)
        layer = torch.cat([linear(lit, gamma) * observed.mask, observed.mask], 1)
        ground = defocus_background(linear(self._photos(batch), gamma), augment, dice)
        ground = self._cluttered(ground, layer)
        picture = over(ground, self._imaged_layer(soft_edge(layer)))
        picture, covered = occlude(picture, self._things(layer, gamma), augment, dice)
        if self.hands is not None:
            chosen, fronts = self.hands.draw(batch, distance)
            fronts = torch.cat([linear(fronts[:, :3], gamma[chosen]), fronts[:, 3:]], 1)
            picture[chosen] = over(picture[chosen], soft_edge(fronts))
            covered[chosen] = torch.maximum(covered[chosen], fronts[:, 3:])
        picture, covered = crop_region(ground, picture, covered, augment, dice)
        picture, border = cut_border(self._taken(picture, gamma).clamp(0, 1), augment, dice)
        return (picture * 255).round() / 255, (covered < 0.5) * (1 - border)

    def _taken(self, picture: Tensor, gamma: Tensor) -> Tensor:
        """The picture, of linear colours, as the camera takes it."""
        augment, dice, whole = self.augment, self.dice, self.augment.acts_on == "picture"
        picture = shadow(picture, augment, dice)
        if whole:
            picture = radial_blur(blur(picture, augment, dice), augment, dice)
        picture = bend(picture, augment, dice)
        picture = degrade(picture, gamma, augment, dice)
        picture = sharpen(picture, augment, dice)
        return recolour(picture, augment, dice) if whole else picture

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

    def _things(self, layer: Tensor, gamma: Tensor) -> Callable[[Tensor], Tensor]:
        """Where occluders come from, in linear colours."""
        bank = self.bank
        if bank is None:
            photos = linear(self._photos(len(layer)), gamma)
            return loose_things(layer, photos, self.augment, self.dice)
        bank.grow()
        return lambda chosen: self._imaged_layer(bank.draw(len(chosen)))

    def _photos(self, count: int) -> Tensor:
        return self.photos.squares(count, PATCH_SIZE, self.dice)


def linear(colour: Tensor, gamma: Tensor) -> Tensor:
    """Colours as a screen wants them as amounts of light: (B, 3, H, W) by exponents (B, 1, 1, 1)."""
    return colour.clamp(0, 1.5) ** gamma


def soft_edge(layer: Tensor) -> Tensor:
    """A layer (B, 4, H, W) with an edge about a pixel wide, as a camera's pixels would show it."""
    padded = functional.pad(layer, (1, 1, 1, 1))
    # The kernel 1 2 1 along both axes; in place, as memory is what this costs.
    rows = (padded[..., :-2] + padded[..., 2:]).add_(padded[..., 1:-1], alpha=2)
    spread = (rows[..., :-2, :] + rows[..., 2:, :]).add_(rows[..., 1:-1, :], alpha=2).mul_(1 / 16)
    alpha = spread[:, 3:]
    colour = torch.where(layer[:, 3:] > 0.5, layer[:, :3] * alpha, spread[:, :3])
    return torch.cat([colour, alpha], 1)
