"""The background of an object: clutter and boards as often as stated."""

from dataclasses import replace

import pytest
import torch

from moveit6d.synthesis.augmentation.composing import Composer
from moveit6d.synthesis.augmentation.config import (
    AugmentConfig,
    CalibrationBoardConfig,
    ClutterConfig,
)
from moveit6d.synthesis.augmentation.lights import LightConfig
from moveit6d.synthesis.augmentation.photo_bank import PhotoBank
from tests.support.pairs import photos, rng

BACKGROUND = torch.zeros(600, 3, 24, 24)
BANK = PhotoBank(photos(), torch.device("cpu"))


def changed(augment: AugmentConfig, layer: torch.Tensor) -> torch.Tensor:
    """Which of 600 black grounds have something on them."""
    composer = Composer(BANK, augment, LightConfig(), rng())
    seen = composer._cluttered(BACKGROUND, layer)
    assert BACKGROUND.max() == 0, "the ground that was given stays as it is"
    return seen.flatten(1).amax(1) > 0


def test_other_objects_and_boards_are_behind_as_often_as_stated() -> None:
    nothing = AugmentConfig(clutter=ClutterConfig(probability=0.0))
    solid = torch.ones(600, 4, 24, 24)
    assert not changed(nothing, solid).any()
    objects = changed(
        replace(nothing, clutter=ClutterConfig(probability=0.4, max_objects=3)), solid
    )
    assert objects.float().mean() == pytest.approx(0.4, abs=0.06)
    boards = changed(replace(nothing, calibration_board=CalibrationBoardConfig(0.3)), solid)
    assert boards.float().mean() == pytest.approx(0.3, abs=0.06)


def test_each_number_of_objects_behind_is_as_likely() -> None:
    # Small objects at known brightness add up where they overlap nowhere: count by area.
    small = torch.zeros(600, 4, 24, 24)
    small[:, :, 10:14, 10:14] = 1.0
    three = AugmentConfig(clutter=ClutterConfig(1.0, 3, same_object_probability=0.0))
    one = AugmentConfig(clutter=ClutterConfig(1.0, 1, same_object_probability=0.0))
    composer = Composer(BANK, three, LightConfig(), rng())
    single = Composer(BANK, one, LightConfig(), rng())
    several = composer._cluttered(BACKGROUND, small).mean()
    assert float(several / single._cluttered(BACKGROUND, small).mean()) == pytest.approx(
        2, abs=0.35
    )
