"""Hands and cards in front of the object, rendered as large as they would be beside it.

Never decides what lies behind them. Unlike occluders from a bank they reach into the patch from
outside, as an arm does.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ...geometry.crop import OBJECT_SIZE, PATCH_SIZE
from ...geometry.pose import Pose
from ...geometry.rotation import random_rotations
from ...rendering.renderer import Renderer
from .augment import RandomSource
from .lighting import LightConfig
from .occluder_bank import lit_layers
from .occluders import Occluder, card, hand

Range = tuple[float, float]
FIRST = 4  # hands and cards that the first batch has to choose from
WIDTH = 0.084  # metres across the palm of `occluders.hand`; cards are about as wide


@dataclass(frozen=True)
class HandConfig:
    """How often a hand or a card is in front of the object, and how large; pixels of the patch."""

    share: float = 0.0
    cards: float = 0.35  # share of them that are cards
    width: Range = (22.0, 85.0)  # of a palm or a card
    spread: float = 0.75  # of the patch, in which fingertips and cards lie
    kept: int = 16  # different ones at a time …
    renewed_every: int = 6  # … of which one is replaced after so many batches


class Hands:
    """Draws hands and cards as layers; keeps a few, as making one costs more than showing it."""

    def __init__(
        self, config: HandConfig, photos: Sequence[np.ndarray], renderer: Renderer,
        lights: LightConfig, random: np.random.Generator, rng: RandomSource,
    ) -> None:  # fmt: skip
        self.config, self.photos, self.renderer = config, photos, renderer
        self.lights, self.random, self.rng = lights, random, rng
        self.kept: list[Occluder] = []
        self.batches = 0

    def draw(self, batch: int, distance: Tensor) -> tuple[Tensor, Tensor]:
        """Which of the patches have one (n,), and the layers (n, 4, 128, 128) for them.

        `distance` (B,) in diameters gives each patch's perspective.
        """
        chosen = self.rng.chance(batch, self.config.share).nonzero()[:, 0]
        if not len(chosen):
            return chosen, torch.zeros(0, 4, PATCH_SIZE, PATCH_SIZE)
        self._renew()
        things = [self.kept[int(self.random.integers(len(self.kept)))] for _ in chosen]
        near = distance[chosen].double()
        poses = self._poses(things, OBJECT_SIZE * near)
        meshes = [thing.mesh for thing in things]
        return chosen, lit_layers(self.renderer, meshes, poses, near, self.lights, self.rng)

    def _renew(self) -> None:
        """One more while there are few, and one replaced now and then."""
        self.batches += 1
        full = len(self.kept) >= self.config.kept
        if full and self.batches % self.config.renewed_every:
            return
        if full:
            self.kept.pop(int(self.random.integers(len(self.kept))))
        for _ in range(1 if self.kept else FIRST):
            is_card = self.random.random() < self.config.cards
            made = card(self.random, 1.0, self.photos) if is_card else hand(self.random)
            self.kept.append(made)

    def _poses(self, things: Sequence[Occluder], focal: Tensor) -> Pose:
        """Fingertips and cards somewhere in the patch; arms leave it by the nearest side or so."""
        count = len(things)
        place = self.rng.uniform(count, 2, between=(-0.5, 0.5)).double()
        place = place * self.config.spread * PATCH_SIZE
        depth = focal * WIDTH / self.rng.uniform(count, between=self.config.width)
        outward = torch.atan2(place[:, 1], place[:, 0])
        outward = outward + self.rng.uniform(count, between=(-1.2, 1.2))
        free = random_rotations(count, self.rng.generator)
        turns = [
            free[k] if things[k].along is None else self._reaching(float(outward[k]))
            for k in range(count)
        ]
        rotation = torch.stack(turns)
        tips = torch.stack([torch.from_numpy(np.asarray(thing.tip)) for thing in things])
        tip = torch.cat([place / focal[:, None], torch.ones(count, 1, dtype=torch.float64)], 1)
        return Pose(rotation, tip * depth[:, None] - (rotation @ tips[..., None])[..., 0])

    def _reaching(self, angle: float) -> Tensor:
        """A turn (3, 3) that points a hand's arm (−y) along `angle` in the picture, near the plane.

        Of the two sides of a hand either may be seen.
        """
        tilt, roll = self.rng.uniform(2, between=(-1.0, 1.0)).tolist()
        flip = math.pi * (self.random.random() < 0.5)
        about_y = _turn(1, flip + 0.7 * roll)
        about_x = _turn(0, 0.35 * tilt)
        return _turn(2, angle + math.pi / 2) @ about_x @ about_y


def _turn(axis: int, angle: float) -> Tensor:
    cosine, sine = math.cos(angle), math.sin(angle)
    first, second = (axis + 1) % 3, (axis + 2) % 3
    matrix = torch.eye(3, dtype=torch.float64)
    matrix[first, first] = matrix[second, second] = cosine
    matrix[first, second], matrix[second, first] = -sine, sine
    return matrix
