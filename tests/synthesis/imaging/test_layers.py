"""Layers: compositing against its formula, edges against a plain convolution."""

import pytest
import torch

from moveit6d.synthesis.imaging.layers import (
    blend,
    linear_layer,
    over,
    premultiplied,
    soft_edge,
    unpremultiplied,
)
from moveit6d.synthesis.imaging.linear_light import to_linear


def test_over_is_the_usual_formula() -> None:
    picture, layer = torch.full((1, 3, 1, 1), 0.8), torch.tensor([0.1, 0.2, 0.0, 0.25])
    seen = over(picture, layer[None, :, None, None])[0, :, 0, 0]
    assert seen.tolist() == pytest.approx([0.7, 0.8, 0.6])


def test_a_premultiplied_layer_over_an_image_is_a_blend() -> None:
    generator = torch.Generator().manual_seed(0)
    image, colour = torch.rand(2, 2, 3, 5, 5, generator=generator)
    alpha = torch.rand(2, 1, 5, 5, generator=generator)
    layer = premultiplied(colour, alpha)
    assert torch.allclose(over(image, layer), blend(image, colour, alpha), atol=1e-6)
    found, same = unpremultiplied(layer)
    assert torch.equal(same, alpha) and torch.allclose(
        found[alpha.expand(-1, 3, -1, -1) > 0.01],
        colour[alpha.expand(-1, 3, -1, -1) > 0.01],
        atol=1e-5,
    )


def test_soft_edges_are_a_small_blur_outside_and_of_the_mask() -> None:
    """Against a plain convolution: alpha, and colour times alpha outside of the object."""
    generator = torch.Generator().manual_seed(0)
    mask = (torch.rand(2, 1, 12, 12, generator=generator) > 0.5).float()
    layer = torch.cat([torch.rand(2, 3, 12, 12, generator=generator) * mask, mask], 1)
    line = torch.tensor([0.25, 0.5, 0.25])
    kernel = (line[:, None] * line).expand(4, 1, 3, 3)
    wanted = torch.nn.functional.conv2d(layer, kernel, padding=1, groups=4)
    wanted[:, :3] = torch.where(mask > 0.5, layer[:, :3] * wanted[:, 3:], wanted[:, :3])
    assert torch.allclose(soft_edge(layer), wanted, atol=1e-6)


def bright_pixels(gamma: float) -> float:
    """How many pixels of a row with a blurred edge from white to dark grey are above 0.6."""
    exponent = torch.full((1, 1, 1, 1), gamma)
    white = torch.zeros(1, 4, 8, 64)
    white[..., :32] = 1.0
    dark = torch.full((1, 3, 8, 64), 0.2)
    layer = premultiplied(to_linear(white[:, :3], exponent), white[:, 3:])
    picture = over(to_linear(dark, exponent), soft_edge(layer))
    picture = torch.nn.functional.avg_pool2d(picture, 5, 1, 2, count_include_pad=False)
    row = (picture ** (1 / gamma))[0, 0, 4]
    return float((row[8:] > 0.6).sum())


def test_light_adds_up_at_an_edge_so_that_bright_things_look_larger() -> None:
    assert bright_pixels(1.0) == 24
    assert bright_pixels(2.2) == 25


def test_layers_become_linear_without_their_alpha() -> None:
    alpha = torch.rand(2, 1, 4, 4) * 0.9 + 0.1
    colour = torch.rand(2, 3, 4, 4)
    gamma = torch.tensor([1.0, 2.2])[:, None, None, None]
    found = linear_layer(torch.cat([colour * alpha, alpha], 1), gamma)
    assert torch.allclose(found[:, :3], colour**gamma * alpha, atol=1e-5)
    assert torch.equal(found[:, 3:], alpha)
