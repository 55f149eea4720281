"""What is behind and in front of an object: clutter, boards and occluders as often as stated."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from moveit6d.synthesis.augmentation.composing import Composer
from moveit6d.synthesis.augmentation.config import (
    AugmentConfig,
    CalibrationBoardConfig,
    ClutterConfig,
    OcclusionConfig,
)
from moveit6d.synthesis.augmentation.lights import LightConfig
from moveit6d.synthesis.augmentation.occluder_bank import BankConfig
from moveit6d.synthesis.augmentation.photo_bank import PhotoBank
from moveit6d.synthesis.objects.object_set import MeshObjects
from tests.support.meshes import square
from tests.support.pairs import photos, rng

BACKGROUND = torch.zeros(600, 3, 24, 24)
DIFFERENT = torch.arange(600)  # numbers of objects
BANK = PhotoBank(photos(), torch.device("cpu"))


def changed(augment: AugmentConfig, layer: torch.Tensor) -> torch.Tensor:
    """Which of 600 black grounds have something on them."""
    composer = Composer(BANK, augment, LightConfig(), rng())
    seen = composer._cluttered(BACKGROUND, layer, DIFFERENT)
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
    several, lone = (some._cluttered(BACKGROUND, small, DIFFERENT) for some in (composer, single))
    assert float(several.mean() / lone.mean()) == pytest.approx(2, abs=0.35)


def test_the_object_itself_is_behind_only_as_often_as_stated() -> None:
    """Also where a batch shows nothing else."""
    config = AugmentConfig(clutter=ClutterConfig(1.0, 3, same_object_probability=0.25))
    composer = Composer(BANK, config, LightConfig(), rng())
    seen = composer._cluttered(BACKGROUND, torch.ones(600, 4, 24, 24), torch.zeros(600).long())
    covered = seen.flatten(1).amax(1) > 0
    assert covered.float().mean() == pytest.approx(0.25, abs=0.06)


@pytest.mark.parametrize("probability", [0.0, 0.4, 1.0])
def test_occluders_of_a_bank_and_cutouts_of_photos_are_as_often_as_stated(
    probability: float,
) -> None:
    occlusion = OcclusionConfig(photo_probability=probability)
    white = PhotoBank([np.full((150, 150, 3), 255, np.uint8)], torch.device("cpu"))
    composer = Composer(
        white, AugmentConfig(occlusion=occlusion), LightConfig(unlit_probability=1.0), rng()
    )
    red = MeshObjects([square(colors=np.tile(np.uint8([255, 0, 0]), (4, 1)))])
    bank = BankConfig(size=8, new_per_batch=8)
    composer.use_occluders(red, bank, (3.0, 6.0), np.random.default_rng(0))
    draw = composer._occluders(torch.zeros(200, 4, 128, 128), torch.ones(200, 1, 1, 1))
    cut = draw(torch.arange(200))[:, 1].flatten(1).amax(1) > 0.9
    assert cut.float().mean() == pytest.approx(probability, abs=0.1)
