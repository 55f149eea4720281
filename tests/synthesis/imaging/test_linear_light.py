"""Linear light: the gamma curve, its inverse, and where it is cut off."""

import pytest
import torch

from moveit6d.synthesis.imaging.linear_light import BRIGHTEST, to_display, to_linear


@pytest.mark.parametrize("gamma", [1.0, 1.8, 2.2])
def test_display_colours_come_back(gamma: float) -> None:
    colour = torch.linspace(0, 1, 256)
    assert torch.allclose(to_display(to_linear(colour, gamma), gamma), colour, atol=1e-6)


def test_each_image_has_an_exponent_of_its_own() -> None:
    gamma = torch.tensor([1.0, 2.0])[:, None, None, None]
    light = to_linear(torch.full((2, 3, 2, 2), 0.5), gamma)
    assert (light[0] == 0.5).all() and (light[1] == 0.25).all()


def test_highlights_are_cut_off() -> None:
    light = to_linear(torch.tensor([-1.0, 9.0]), 2.0)
    assert light.tolist() == [0.0, BRIGHTEST**2]
