"""Hands and cards in front of the object, rendered as large as they would be beside it.

Never decides what lies behind them. Unlike occluders from a bank they reach into the crop from
outside, as an arm does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from torch import Tensor

from ...geometry.crop import OBJECT_SIZE, PATCH_SIZE
from ...geometry.pose import Pose
from ...geometry.rotation import exp_so3, random_rotations
from ...typing import Range
from ..objects.object_set import MeshObjects, ObjectSet
from ..objects.occluders import Occluder, card, hand
from .lights import LightConfig
from .occluder_bank import lit_layers
from .random_source import RandomSource

FIRST = 4  # hands and cards that the first batch has to choose from
WIDTH = 0.084  # metres across the palm of `occluders.hand`; cards are about as wide


@dataclass(frozen=True)
class HandConfig:
    """Hands and cards in front of the object.

    Args:
        probability: of a hand or a card.
        card_probability: of it to be a card.
        width: of a palm or a card, pixels of the crop.
        extent: of the crop, within which fingertips and cards lie.
        pool_size: different ones at a time.
        renew_every: batches after which one of them is replaced.
    """

    probability: float = 0.0
    card_probability: float = 0.35
    width: Range = (22.0, 85.0)
    extent: float = 0.75
    pool_size: int = 16
    renew_every: int = 6


class HandSource(Protocol):
    """Where hands and cards come from."""

    def take(self, count: int) -> tuple[ObjectSet, Tensor, Tensor, Tensor]:
        """Some of them: the set, numbers (count,), tips (count, 3) and which (count,) are hands."""


class ProceduralHands:
    """Makes hands and cards as it goes; keeps a few, as making one costs more than showing it."""

    def __init__(
        self, config: HandConfig, photos: Sequence[np.ndarray], random: np.random.Generator
    ) -> None:
        self.config, self.photos, self.random = config, photos, random
        self.kept: list[Occluder] = []
        self.batches = 0

    def take(self, count: int) -> tuple[ObjectSet, Tensor, Tensor, Tensor]:
        """See `HandSource`."""
        self._renew()
        index = torch.from_numpy(self.random.integers(len(self.kept), size=count))
        things = [self.kept[number] for number in index.tolist()]
        tips = torch.from_numpy(np.stack([np.asarray(thing.tip) for thing in things]))
        reaching = torch.tensor([thing.along is not None for thing in things])
        return MeshObjects([thing.mesh for thing in self.kept]), index, tips, reaching

    def _renew(self) -> None:
        """One more while there are few, and one replaced now and then."""
        self.batches += 1
        full = len(self.kept) >= self.config.pool_size
        if full and self.batches % self.config.renew_every:
            return
        if full:
            self.kept.pop(int(self.random.integers(len(self.kept))))
        for _ in range(1 if self.kept else FIRST):
            hand_or_card = procedural_hand(self.random, self.config.card_probability, self.photos)
            self.kept.append(hand_or_card)


def procedural_hand(
    random: np.random.Generator, cards: float, photos: Sequence[np.ndarray]
) -> Occluder:
    """A new hand, or a card in a share of the cases."""
    return card(random, 1.0, photos) if random.random() < cards else hand(random)


class Hands:
    """Draws hands and cards as layers."""

    def __init__(
        self, config: HandConfig, source: HandSource, lights: LightConfig, rng: RandomSource
    ) -> None:
        self.config, self.source, self.lights, self.rng = config, source, lights, rng

    def draw(self, batch: int, distance: Tensor) -> tuple[Tensor, Tensor]:
        """Which of the crops have one (n,), and the layers (n, 4, 128, 128) for them.

        `distance` (B,) in diameters gives each crop's perspective.
        """
        chosen = self.rng.chosen(batch, self.config.probability)
        if not len(chosen):
            return chosen, torch.zeros(0, 4, PATCH_SIZE, PATCH_SIZE, device=chosen.device)
        objects, index, tips, reaching = self.source.take(len(chosen))
        near = distance[chosen].double()
        poses = self._poses(tips.to(near), reaching.to(near.device), OBJECT_SIZE * near)
        return chosen, lit_layers(objects, index, poses, near, self.lights, self.rng)

    def _poses(self, tips: Tensor, reaching: Tensor, focal: Tensor) -> Pose:
        """Fingertips and cards at random places; arms leave the crop by about the nearest side."""
        count, rng = len(tips), self.rng
        place = rng.uniform(count, 2, between=(-0.5, 0.5)).double()
        place = place * self.config.extent * PATCH_SIZE
        depth = focal * WIDTH / rng.uniform(count, between=self.config.width)
        outward = torch.atan2(place[:, 1], place[:, 0])
        outward = outward + rng.uniform(count, between=(-1.2, 1.2))
        free = random_rotations(count, rng.generator)
        rotation = torch.where(reaching[:, None, None], self._reaching(outward), free)
        tip = torch.cat([place / focal[:, None], torch.ones_like(focal)[:, None]], 1)
        return Pose(rotation, tip * depth[:, None] - (rotation @ tips[..., None])[..., 0])

    def _reaching(self, angle: Tensor) -> Tensor:
        """Turns (n, 3, 3) that point a hand's arm (−y) along `angle` (n,), near the image plane.

        Of the two sides of a hand either may be seen.
        """
        count, rng = len(angle), self.rng
        tilt, roll = rng.uniform(2, count, between=(-1.0, 1.0)).double()
        flip = math.pi * rng.bernoulli(count, 0.5)
        return _turn(2, angle + math.pi / 2) @ _turn(0, 0.35 * tilt) @ _turn(1, flip + 0.7 * roll)


def _turn(axis: int, angle: Tensor) -> Tensor:
    """Turns (n, 3, 3) about one axis by angles (n,)."""
    vector = torch.zeros(len(angle), 3, dtype=angle.dtype, device=angle.device)
    vector[:, axis] = angle
    return exp_so3(vector)
