"""Puts an observed patch together: photo, clutter, the lit object, occluders, the camera.

Never renders the object itself. The same steps make the paper's pictures and the realistic ones;
which of them happen, how often and how much is `AugmentConfig`, `HandConfig` and `BankConfig`.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ...geometry.crop import PATCH_SIZE
from ...rendering.renderer import GBuffer
from ..objects.object_set import ObjectSet
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
from .photo_bank import PhotoBank


class Composer:
    """Makes observed patches of what is rendered; its occluders are made as it goes.

    What reaches a pixel from several things, at an edge or in a blur, adds up as light does, so
    colours are made linear first (`AugmentConfig.gamma`): before something dark, something bright
    looks larger.
    """

    def __init__(
        self, photos: PhotoBank, augment: AugmentConfig, lights: LightConfig, rng: RandomSource
    ) -> None:
        self.photos, self.augment, self.lights, self.rng = photos, augment, lights, rng
        self.bank: OccluderBank | None = None
        self.hands: Hands | None = None

    def use_bank(
        self, config: BankConfig, objects: ObjectSet, distance: tuple[float, float],
        random: np.random.Generator,
    ) -> None:  # fmt: skip
        """Take occluders from a bank of these objects' patches; of size 0, from none."""
        if config.size > 0:
            self.bank = OccluderBank(objects, config, self.lights, distance, self.rng, random)

    def use_hands(
        self, config: HandConfig, source: HandSource, random: np.random.Generator
    ) -> None:
        """Put hands and cards in front as well."""
        self.hands = Hands(config, source, self.lights, random, self.rng)

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
        gamma = rng.uniform(batch, 1, 1, 1, between=augment.gamma)
        layer = torch.cat([linear(lit, gamma) * observed.mask, observed.mask], 1)
        background = defocus_background(linear(self._photos(batch), gamma), augment, rng)
        background = self._cluttered(background, layer)
        picture = over(background, self._imaged_layer(soft_edge(layer)))
        picture, occlusion = occlude(picture, self._things(layer, gamma), augment, rng)
        if self.hands is not None:
            chosen, fronts = self.hands.draw(batch, distance)
            fronts = linear_layer(fronts, gamma[chosen])
            picture[chosen] = over(picture[chosen], soft_edge(fronts))
            occlusion[chosen] = torch.maximum(occlusion[chosen], fronts[:, 3:])
        picture, occlusion = crop_region(background, picture, occlusion, augment, rng)
        picture, border = cut_border(self._taken(picture, gamma).clamp(0, 1), augment, rng)
        return (picture * 255).round() / 255, (occlusion < 0.5) * (1 - border)

    def _taken(self, picture: Tensor, gamma: Tensor) -> Tensor:
        """The picture, of linear colours, as the camera takes it."""
        augment, rng, whole = self.augment, self.rng, self.augment.acts_on == "picture"
        picture = shadow(picture, augment, rng)
        if whole:
            picture = radial_blur(blur(picture, augment, rng), augment, rng)
        picture = perturb_lens(picture, augment, rng)
        picture = degrade(picture, gamma, augment, rng)
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

    def _things(self, layer: Tensor, gamma: Tensor) -> Callable[[Tensor], Tensor]:
        """Where occluders come from, in linear colours."""
        bank = self.bank
        if bank is None:
            photos = linear(self._photos(len(layer)), gamma)
            return loose_things(layer, photos, self.augment, self.rng)
        bank.grow()
        return lambda chosen: linear_layer(
            self._imaged_layer(bank.draw(len(chosen))), gamma[chosen]
        )

    def _photos(self, count: int) -> Tensor:
        return self.photos.squares(count, PATCH_SIZE, self.rng)


def linear(colour: Tensor, gamma: Tensor) -> Tensor:
    """Colours (B, 3, H, W) as amounts of light, by the exponents (B, 1, 1, 1) of a screen."""
    return colour.clamp(0, 1.5) ** gamma


def linear_layer(layer: Tensor, gamma: Tensor) -> Tensor:
    """`linear` for the colours of layers (B, 4, H, W) of colour × alpha and alpha."""
    colour, alpha = loose(layer)
    return torch.cat([linear(colour, gamma) * alpha, alpha], 1)


def soft_edge(layer: Tensor) -> Tensor:
    """A layer (B, 4, H, W) with an edge about a pixel wide, as a camera's pixels would show it."""
    padded = functional.pad(layer, (1, 1, 1, 1))
    # The kernel 1 2 1 along both axes; in place, as memory is what this costs.
    rows = (padded[..., :-2] + padded[..., 2:]).add_(padded[..., 1:-1], alpha=2)
    spread = (rows[..., :-2, :] + rows[..., 2:, :]).add_(rows[..., 1:-1, :], alpha=2).mul_(1 / 16)
    alpha = spread[:, 3:]
    colour = torch.where(layer[:, 3:] > 0.5, layer[:, :3] * alpha, spread[:, :3])
    return torch.cat([colour, alpha], 1)
