"""Occluders, windows and borders: as often and as large as the configuration says."""

import numpy as np
import pytest
import torch
from torch import Tensor

from moveit6d.synthesis.augmentation.config import (
    CastShadowConfig,
    ImageBorderConfig,
    OcclusionConfig,
    VisibleWindowConfig,
)
from moveit6d.synthesis.augmentation.occlusion import (
    calibration_boards,
    cast_shadow,
    cut_border,
    occlude,
    occluder_source,
    scatter,
    show_window,
)
from tests.support.pairs import preset, rng

PAPER = preset("paper").augment
GREY = torch.full((2000, 3, 16, 16), 0.5)


def numbers_of_occluders(config: OcclusionConfig) -> np.ndarray:
    """How many occluders were put in front of each of the crops."""
    counts = torch.zeros(len(GREY))

    def occluders(chosen: Tensor) -> Tensor:
        counts[chosen] += 1
        return torch.zeros(len(chosen), 4, 16, 16)

    occlude(GREY, occluders, config, rng())
    return counts.numpy().astype(int)


def test_the_paper_s_occluders_are_none_in_half_and_one_to_four_in_an_eighth_each() -> None:
    found = np.bincount(numbers_of_occluders(PAPER.occlusion), minlength=5) / len(GREY)
    assert found == pytest.approx([0.5, 0.125, 0.125, 0.125, 0.125], abs=0.03)


def test_our_occluders_are_as_many_as_stated() -> None:
    config = OcclusionConfig(probability=0.6)
    found = np.bincount(numbers_of_occluders(config), minlength=4) / len(GREY)
    assert found == pytest.approx([0.4, 0.2, 0.2, 0.2], abs=0.03)


def test_what_is_pasted_is_what_is_said_to_be_covered() -> None:
    config = OcclusionConfig(probability=1.0, max_occluders=1, scale=(0.5, 0.5))
    solid = torch.ones(200, 4, 32, 32)
    black = torch.zeros(200, 3, 32, 32)
    picture, occlusion = occlude(black, lambda chosen: solid[chosen], config, rng())
    assert torch.allclose(picture[:, :1], occlusion, atol=1e-6) and black.max() == 0
    whole = (occlusion > 0.5).flatten(1).sum(1).float()
    assert whole.max() == pytest.approx((0.5 * 32) ** 2, rel=0.15)


def test_occluders_are_other_objects_and_cutouts_of_photos() -> None:
    draw = occluder_source(
        lambda count: torch.full((count, 4, 24, 24), 0.25),
        lambda count: torch.ones(count, 3, 24, 24),
        OcclusionConfig(photo_probability=0.45),
        rng(),
    )
    layers = draw(torch.arange(400))
    cut = (layers[:, 3].flatten(1).amax(1) == 1).float()
    assert cut.mean() == pytest.approx(0.45, abs=0.08)
    assert (layers[cut == 0] == 0.25).all()
    pieces = layers[cut == 1]
    assert torch.equal(pieces[:, 0], pieces[:, 3]), "colour times alpha, of white photos"


@pytest.mark.parametrize("rotated", [True, False])
def test_layers_are_rotated_only_if_wanted(rotated: bool) -> None:
    layers = torch.zeros(50, 1, 64, 64)
    layers[:, :, 24:40, 16:48] = 1
    placed = scatter(layers, torch.ones(50), 0.2, rng(), rotated)
    rows = (placed[:, 0] > 0.5).any(-1).sum(-1)
    columns = (placed[:, 0] > 0.5).any(-2).sum(-1)
    upright = ((rows - 16).abs() <= 1) & ((columns - 32).abs() <= 1)
    assert upright.all() if not rotated else upright.float().mean() < 0.3


def test_the_paper_s_window_leaves_a_rectangle_of_72_to_96_in_a_quarter() -> None:
    front = torch.ones(500, 1, 128, 128)
    picture, occlusion = show_window(0 * front, front, 0 * front, PAPER.visible_window, rng())
    assert torch.equal(picture, 1 - occlusion)
    cropped = occlusion.flatten(1).amax(1) > 0
    assert cropped.float().mean() == pytest.approx(0.25, abs=0.05)
    shown = occlusion[cropped, 0] == 0
    high, wide = shown.any(-1).sum(-1), shown.any(-2).sum(-1)
    for extent in (high, wide):
        assert extent.min() >= 72 and extent.max() <= 96 and extent.max() - extent.min() > 20
    assert torch.equal(shown.flatten(1).sum(1), high * wide), "one whole rectangle"


def test_without_a_window_nothing_is_hidden() -> None:
    front, none = torch.ones(9, 3, 128, 128), torch.zeros(9, 1, 128, 128)
    picture, occlusion = show_window(0 * front, front, none, VisibleWindowConfig(), rng())
    assert torch.equal(picture, front) and occlusion.max() == 0


def test_borders_are_black_and_known() -> None:
    config = ImageBorderConfig(probability=0.3)
    picture, border = cut_border(torch.ones(300, 3, 32, 32), config, rng())
    assert torch.equal(picture[:, :1], 1 - border)
    share = float((border.flatten(1).amax(1) > 0).float().mean())
    assert 0.2 < share < 0.4


def test_shadows_darken_a_side_by_what_is_stated() -> None:
    config = CastShadowConfig(probability=0.4, brightness=(0.5, 0.6))
    lit = cast_shadow(torch.ones(600, 1, 32, 32), config, rng()).flatten(1)
    darkest = lit.amin(1)
    assert (darkest < 0.99).float().mean() == pytest.approx(0.4, abs=0.06)
    assert darkest.min() >= 0.5 - 1e-6 and lit.max() <= 1 + 1e-6


def test_boards_are_dark_and_light_anywhere_and_premultiplied() -> None:
    layers = calibration_boards(300, 64, rng())
    alpha, colour = layers[:, 3:], layers[:, :3]
    assert layers.shape == (300, 4, 64, 64) and (colour <= alpha + 1e-5).all()
    whole = (alpha[:, 0] > 0.999).flatten(1)
    occlusion = whole.float().mean(1)
    assert occlusion.min() < 0.25 and occlusion.max() > 0.8
    inside = colour.permute(0, 2, 3, 1)[alpha[:, 0] > 0.999]
    dark, light = (inside.amax(1) <= 0.251).float().mean(), (inside.amin(1) >= 0.699).float().mean()
    assert 0.35 < dark < 0.65 and 0.35 < light < 0.65
    assert dark + light > 0.75, "the rest are edges between squares"
