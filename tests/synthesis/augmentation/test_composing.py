"""What lies behind an object: as often as stated, and never before it."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from moveit6d.synthesis.augmentation.augment import AugmentConfig
from moveit6d.synthesis.augmentation.composing import Composer
from moveit6d.synthesis.augmentation.lighting import LightConfig
from tests.support.pairs import photos, rng

BACKGROUND = torch.zeros(600, 3, 24, 24)


def changed(augment: AugmentConfig, layer: torch.Tensor) -> torch.Tensor:
    """Which of 600 black grounds have something on them."""
    random = np.random.default_rng(0)
    composer = Composer(list(photos()), augment, LightConfig(), random, rng())
    seen = composer._cluttered(BACKGROUND, layer)
    assert BACKGROUND.max() == 0, "the ground that was given stays as it is"
    return seen.flatten(1).amax(1) > 0


def test_other_objects_and_boards_lie_behind_as_often_as_stated() -> None:
    nothing = AugmentConfig(cluttered=0.0, boards=0.0)
    solid = torch.ones(600, 4, 24, 24)
    assert not changed(nothing, solid).any()
    objects = changed(replace(nothing, cluttered=0.4, clutter=3), solid)
    assert objects.float().mean() == pytest.approx(0.4, abs=0.06)
    calibration_boards = changed(replace(nothing, boards=0.3), solid)
    assert calibration_boards.float().mean() == pytest.approx(0.3, abs=0.06)


def test_each_number_of_objects_behind_is_as_likely() -> None:
    # Small objects at known brightness add up where they overlap nowhere: count by area.
    small = torch.zeros(600, 4, 24, 24)
    small[:, :, 10:14, 10:14] = 1.0
    augment = AugmentConfig(cluttered=1.0, boards=0.0, clutter=3, same_colour_distractors=0.0)
    random = np.random.default_rng(0)
    composer = Composer(list(photos()), augment, LightConfig(), random, rng())
    one = replace(augment, clutter=1)
    single = Composer(list(photos()), one, LightConfig(), random, rng())
    several = composer._cluttered(BACKGROUND, small).mean()
    assert float(several / single._cluttered(BACKGROUND, small).mean()) == pytest.approx(
        2, abs=0.35
    )
