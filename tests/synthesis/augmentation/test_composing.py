"""What lies behind an object: as often as stated, and never before it."""

from dataclasses import replace

import pytest
import torch

from moveit6d.synthesis.augmentation.augment import AugmentConfig
from moveit6d.synthesis.augmentation.composing import (
    Composer,
    linear,
    linear_layer,
    over,
    soft_edge,
)
from moveit6d.synthesis.augmentation.lighting import LightConfig
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
    composer = Composer(BANK, augment, LightConfig(), rng())
    one = replace(augment, clutter=1)
    single = Composer(BANK, one, LightConfig(), rng())
    several = composer._cluttered(BACKGROUND, small).mean()
    assert float(several / single._cluttered(BACKGROUND, small).mean()) == pytest.approx(
        2, abs=0.35
    )


def half_covered(gamma: float) -> float:
    """Where, along a row, a blurred edge from white to dark grey passes the middle of both."""
    exponent = torch.full((1, 1, 1, 1), gamma)
    white = torch.zeros(1, 4, 8, 64)
    white[..., :32] = 1.0
    dark = torch.full((1, 3, 8, 64), 0.2)
    layer = torch.cat([linear(white[:, :3], exponent) * white[:, 3:], white[:, 3:]], 1)
    picture = over(linear(dark, exponent), soft_edge(layer))
    picture = torch.nn.functional.avg_pool2d(picture, 5, 1, 2, count_include_pad=False)
    row = (picture ** (1 / gamma))[0, 0, 4]
    return float((row[8:] > 0.6).sum())


def test_light_adds_up_at_an_edge_so_that_bright_things_look_larger() -> None:
    assert half_covered(1.0) == 24
    assert half_covered(2.2) == 25


def test_layers_become_linear_without_their_alpha() -> None:
    alpha = torch.rand(2, 1, 4, 4) * 0.9 + 0.1
    colour = torch.rand(2, 3, 4, 4)
    gamma = torch.tensor([1.0, 2.2])[:, None, None, None]
    found = linear_layer(torch.cat([colour * alpha, alpha], 1), gamma)
    assert torch.allclose(found[:, :3], colour**gamma * alpha, atol=1e-5)
    assert torch.equal(found[:, 3:], alpha)
