"""Composes the observed crop: photo, clutter, the shaded object, occluders, camera effects.

Never renders the object itself. The same steps make the paper's pairs and the realistic ones;
which of them happen, how often and how strongly is said by `AugmentConfig`, `HandConfig` and
`BankConfig`.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import torch
from torch import Tensor

from ...geometry.crop import PATCH_SIZE
from ...rendering.renderer import GBuffer
from ...typing import Range
from ..imaging.layers import linear_layer, over, premultiplied, soft_edge, unpremultiplied
from ..imaging.linear_light import to_linear
from ..objects.object_set import ObjectSet
from .camera_effects import (
    colour_jitter,
    random_blur,
    random_digitization,
    random_gaussian_blur,
    random_lens_error,
    random_noise,
    random_object_motion,
    random_radial_blur,
    random_sharpening,
)
from .config import AugmentConfig
from .hands import HandConfig, Hands, HandSource
from .lights import LightConfig, random_lighting
from .occluder_bank import BankConfig, OccluderBank, random_layers
from .occlusion import (
    calibration_boards,
    cast_shadow,
    cut_border,
    occlude,
    occluder_source,
    random_counts,
    scatter,
    show_window,
)
from .photo_bank import PhotoBank
from .random_source import RandomSource


class Composer:
    """Makes observed crops of what is rendered; its occluders are rendered as it goes.

    Colours are made linear first (`AugmentConfig.gamma`), as light adds up at edges and in blurs:
    in front of something dark, something bright looks larger.
    """

    def __init__(
        self, photos: PhotoBank, augment: AugmentConfig, lights: LightConfig, rng: RandomSource
    ) -> None:
        self.photos, self.augment, self.lights, self.rng = photos, augment, lights, rng
        self.bank: OccluderBank | None = None
        self.other_objects: Callable[[int], Tensor] | None = None
        self.hands: Hands | None = None

    def use_occluders(
        self, objects: ObjectSet, config: BankConfig, distance: Range, random: np.random.Generator
    ) -> None:
        """Take occluders from these objects, not from the batch: from a bank unless its size is 0.

        `distance` is theirs in diameters.
        """
        lights, rng = self.lights, self.rng
        if config.size > 0:
            self.bank = OccluderBank(objects, config, lights, distance, rng, random)
            self.other_objects = self.bank.draw
        else:
            self.other_objects = partial(
                random_layers, objects=objects, distances=distance, lights=lights, rng=rng,
                random=random,
            )  # fmt: skip

    def use_hands(self, config: HandConfig, source: HandSource) -> None:
        """Put hands and cards in front as well."""
        self.hands = Hands(config, source, self.lights, self.rng)

    def picture(
        self, observed: GBuffer, depth: Tensor, distance: Tensor, index: Tensor
    ) -> tuple[Tensor, Tensor]:
        """Observed crops (B, 3, 128, 128), and 1 where nothing would occlude the object.

        `depth` (B, 1, 128, 128) is relative to the look-at view's centre and `distance` (B,) that
        centre's, in diameters; `index` (B,) are the objects' numbers.
        """
        augment, rng, batch = self.augment, self.rng, len(distance)
        lit = random_lighting(
            observed.albedo, observed.normal, depth, observed.mask, distance,
            self.lights, rng,
        )  # fmt: skip
        gamma = rng.uniform(batch, 1, 1, 1, between=augment.gamma)
        layer = premultiplied(to_linear(lit, gamma), observed.mask)
        background = to_linear(self._photos(batch), gamma)
        background = random_gaussian_blur(background, augment.background_blur, rng)
        background = self._cluttered(background, layer, index)
        moving = random_object_motion(soft_edge(layer), augment.object_motion, rng)
        picture = over(background, self._camera_layer(moving))
        occluders = self._occluders(layer, gamma)
        picture, occlusion = occlude(picture, occluders, augment.occlusion, rng)
        if self.hands is not None:
            chosen, fronts = self.hands.draw(batch, distance)
            fronts = linear_layer(fronts, gamma[chosen])
            picture[chosen] = over(picture[chosen], soft_edge(fronts))
            occlusion[chosen] = torch.maximum(occlusion[chosen], fronts[:, 3:])
        window = augment.visible_window
        picture, occlusion = show_window(background, picture, occlusion, window, rng)
        picture = self._through_camera(picture, gamma).clamp(0, 1)
        picture, border = cut_border(picture, augment.image_border, rng)
        return (picture * 255).round() / 255, (occlusion < 0.5) * (1 - border)

    def _through_camera(self, picture: Tensor, gamma: Tensor) -> Tensor:
        """The picture, of linear colours, as the camera records it."""
        augment, rng = self.augment, self.rng
        whole = augment.blur_and_colour_of == "image"
        picture = cast_shadow(picture, augment.cast_shadow, rng)
        if whole:
            picture = self._blurred(picture)
        picture = random_lens_error(picture, augment.lens_error, rng)
        picture = random_digitization(picture, gamma, augment.downsampling, augment.jpeg, rng)
        picture = random_sharpening(picture, augment.sharpening, rng)
        return self._recoloured(picture) if whole else picture

    def _camera_layer(self, layer: Tensor) -> Tensor:
        """Blur and colour of one layer alone, if that is what they act on."""
        if self.augment.blur_and_colour_of == "image":
            return layer
        colour, alpha = unpremultiplied(self._blurred(layer))
        return premultiplied(self._recoloured(colour).clamp(0, 1), alpha)

    def _blurred(self, image: Tensor) -> Tensor:
        image = random_blur(image, self.augment.blur, self.rng)
        return random_radial_blur(image, self.augment.radial_blur, self.rng)

    def _recoloured(self, image: Tensor) -> Tensor:
        image = colour_jitter(image, self.augment.colour, self.rng)
        return random_noise(image, self.augment.noise, self.rng)

    def _cluttered(self, background: Tensor, layer: Tensor, index: Tensor) -> Tensor:
        """Photos (B, 3, N, N) with boards and other objects of the batch in a part of them."""
        augment, rng, batch = self.augment, self.rng, len(background)
        background, index = background.clone(), index.to(background.device)
        with_board = rng.chosen(batch, augment.calibration_board.probability)
        if len(with_board):
            background[with_board] = over(
                background[with_board],
                calibration_boards(len(with_board), background.shape[-1], rng),
            )
        clutter = augment.clutter
        counts = random_counts(batch, clutter.probability, clutter.max_objects, rng)
        for number, behind in enumerate(counts):
            same = rng.bernoulli(len(behind), clutter.same_object_probability) & (number == 0)
            other = torch.where(same, behind, rng.permutation(batch)[: len(behind)])
            placed = scatter(layer[other], rng.uniform(len(behind), between=(0.4, 1.1)), 1.0, rng)
            # The object once more only where that is meant: a batch may hold no other one.
            shown = same | (index[other] != index[behind])
            background[behind] = over(background[behind], placed * shown[:, None, None, None])
        return background

    def _occluders(self, layer: Tensor, gamma: Tensor) -> Callable[[Tensor], Tensor]:
        """A source of occluders in linear colours."""
        config, rng = self.augment.occlusion, self.rng
        if self.other_objects is None:
            photos = to_linear(self._photos(len(layer)), gamma)
            return occluder_source(self._some_of(layer), self._some_of(photos), config, rng)
        if self.bank is not None:
            self.bank.grow()
        draw = occluder_source(self.other_objects, self._photos, config, rng)
        return lambda chosen: linear_layer(self._camera_layer(draw(chosen)), gamma[chosen])

    def _some_of(self, batch: Tensor) -> Callable[[int], Tensor]:
        """Draws some of a batch's layers or photos, none of them twice."""
        return lambda count: batch[self.rng.permutation(len(batch))[:count]]

    def _photos(self, count: int) -> Tensor:
        return self.photos.squares(count, PATCH_SIZE, self.rng)
