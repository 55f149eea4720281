"""What lies behind an object: as often as stated, and never before it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from moveit6d.synthesis.augmentation.augment import AugmentConfig
from moveit6d.synthesis.augmentation.composing import Composer
from moveit6d.synthesis.augmentation.lighting import LightConfig
from tests.support.pairs import dice, photos

GROUND = torch.zeros(600, 3, 24, 24)


def changed(augment: AugmentConfig, layer: torch.Tensor) -> torch.Tensor:
    """Which of 600 black grounds have something on them."""
    random = np.random.default_rng(0)
    composer = Composer(list(photos()), augment, LightConfig(), random, dice())
    seen = composer._cluttered(GROUND, layer)
    assert GROUND.max() == 0, "the ground that was given stays as it is"
    return seen.flatten(1).amax(1) > 0


def test_other_objects_and_boards_lie_behind_as_often_as_stated() -> None:
    nothing = AugmentConfig(cluttered=0.0, marked=0.0)
    solid = torch.ones(600, 4, 24, 24)
    assert not changed(nothing, solid).any()
    objects = changed(replace(nothing, cluttered=0.4, clutter=3), solid)
    assert objects.float().mean() == pytest.approx(0.4, abs=0.06)
    boards = changed(replace(nothing, marked=0.3), solid)
    assert boards.float().mean() == pytest.approx(0.3, abs=0.06)


def test_each_number_of_objects_behind_is_as_likely() -> None:
    # Small objects at known brightness add up where they overlap nowhere: count by area.
    small = torch.zeros(600, 4, 24, 24)
    small[:, :, 10:14, 10:14] = 1.0
    augment = AugmentConfig(cluttered=1.0, marked=0.0, clutter=3, twins=0.0)
    random = np.random.default_rng(0)
    composer = Composer(list(photos()), augment, LightConfig(), random, dice())
    one = replace(augment, clutter=1)
    single = Composer(list(photos()), one, LightConfig(), random, dice())
    several = composer._cluttered(GROUND, small).mean()
    assert float(several / single._cluttered(GROUND, small).mean()) == pytest.approx(2, abs=0.35)
