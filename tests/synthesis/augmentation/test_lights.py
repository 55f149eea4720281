"""Lights and materials: the paper's shares, ranges and colours."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from torch import Tensor

from moveit6d.synthesis.augmentation.lights import LIGHT_COLOURS, LightConfig, random_lighting
from tests.support.pairs import preset, rng

PAPER = preset("paper").lights
COUNT = 1500


def lit(config: LightConfig, albedo: float = 0.5, count: int = COUNT) -> Tensor:
    """One pixel of surface that looks at the camera, under many lights: (count, 3)."""
    shape = (count, 3, 1, 1)
    facing = torch.tensor([0.0, 0.0, -1.0])[None, :, None, None].expand(shape)
    one, flat = torch.ones(count, 1, 1, 1), torch.zeros(count, 1, 1, 1)
    return random_lighting(
        torch.full(shape, albedo),
        facing,
        flat,
        one,
        torch.full((count,), 4.0),
        config,
        rng(),
    )[..., 0, 0]


def test_a_fifth_is_unlit() -> None:
    plain = (lit(PAPER) == 0.5).all(1).float()
    assert plain.mean() == pytest.approx(0.2, abs=0.03)


def test_the_paper_s_numbers_are_in_its_preset() -> None:
    assert (PAPER.unlit_probability, PAPER.count, PAPER.intensity) == (0.2, 5, (0.5, 1.5))
    assert (PAPER.metallic, PAPER.smoothness) == ((0.0, 0.85), (0.0, 0.8))
    blue, cyan, green = (0, 0, 1), (0, 1, 1), (0, 1, 0)
    magenta, red, yellow, white = (1, 0, 1), (1, 0, 0), (1, 1, 0), (1, 1, 1)
    assert set(PAPER.colours) == {blue, cyan, green, magenta, red, yellow, white}


def test_all_five_lights_have_one_of_seven_colours_each_as_often() -> None:
    dark = replace(PAPER, unlit_probability=0.0, ambient=(0.0, 0.0), metallic=(0.0, 0.0))
    colour = lit(dark)
    shown = (colour > 1e-4).int().numpy()
    shares = [(shown == np.array(one, int)).all(1).mean() for one in LIGHT_COLOURS]
    assert shares == pytest.approx([1 / 7] * 7, abs=0.035)
    assert sum(shares) == pytest.approx(1.0)


def test_ambient_light_stays_white_where_it_is_to() -> None:
    still = replace(
        PAPER, unlit_probability=0.0, intensity=(0.0, 0.0), ambient=(0.5, 0.5), metallic=(0.0, 0.0)
    )
    assert torch.allclose(lit(still, 0.8), torch.tensor(0.4))
    tinted = lit(replace(still, ambient_tint=1.0), 0.8)
    assert tinted.min() == 0 and tinted.max() == pytest.approx(0.4)


def test_brightness_follows_intensity_and_colour_gain() -> None:
    """Every draw is the same, so that the results differ by the factors alone."""
    steady = replace(
        PAPER,
        unlit_probability=0.0,
        ambient=(0.0, 0.0),
        metallic=(0.0, 0.0),
        smoothness=(0.0, 0.0),
        colour_gain=(1.0, 1.0),
        colours=((1.0, 1.0, 1.0),),
        intensity=(1.0, 1.0),
    )
    one = lit(steady)
    assert torch.allclose(lit(replace(steady, intensity=(1.5, 1.5))), 1.5 * one, rtol=1e-5)
    assert torch.allclose(lit(replace(steady, colour_gain=(1.2, 1.2))), 1.2 * one, rtol=1e-5)
    ratio = (lit(replace(steady, intensity=(0.5, 1.5))) / one)[:, 0]
    assert ratio.min() >= 0.5 and ratio.max() <= 1.5
    assert ratio.mean() == pytest.approx(1.0, abs=0.02)
