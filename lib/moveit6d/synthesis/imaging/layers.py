"""Layers of premultiplied colour and alpha, and how one is composited over another.

Never decides what lies in front. A layer is (B, 4, H, W): colour × alpha, and alpha in [0, 1].
"""

from __future__ import annotations

import torch
from torch import Tensor
from torch.nn import functional

from .linear_light import to_linear


def over(image: Tensor, layer: Tensor) -> Tensor:
    """A layer over an image (B, 3, H, W): Porter and Duff's operator."""
    return image * (1 - layer[:, 3:]) + layer[:, :3]


def blend(image: Tensor, other: Tensor, alpha: Tensor) -> Tensor:
    """From an image to another one, (B, 3, H, W) each, by alpha (B, 1, H, W) in [0, 1]."""
    return image + (other - image) * alpha


def premultiplied(colour: Tensor, alpha: Tensor) -> Tensor:
    """A layer of colour (B, 3, H, W) and alpha (B, 1, H, W)."""
    return torch.cat([colour * alpha, alpha], 1)


def unpremultiplied(layer: Tensor) -> tuple[Tensor, Tensor]:
    """Colour (B, 3, H, W) and alpha (B, 1, H, W) of a layer."""
    alpha = layer[:, 3:]
    return layer[:, :3] / alpha.clamp_min(1e-3), alpha


def linear_layer(layer: Tensor, gamma: Tensor) -> Tensor:
    """A layer of display colours as one of linear light, by the exponents (B, 1, 1, 1)."""
    colour, alpha = unpremultiplied(layer)
    return premultiplied(to_linear(colour, gamma), alpha)


def soft_edge(layer: Tensor) -> Tensor:
    """A layer with an edge about a pixel wide, as a camera's pixels would show it."""
    padded = functional.pad(layer, (1, 1, 1, 1))
    # The kernel 1 2 1 along both axes; in place, as memory is what this costs.
    rows = (padded[..., :-2] + padded[..., 2:]).add_(padded[..., 1:-1], alpha=2)
    spread = (rows[..., :-2, :] + rows[..., 2:, :]).add_(rows[..., 1:-1, :], alpha=2).mul_(1 / 16)
    alpha = spread[:, 3:]
    colour = torch.where(layer[:, 3:] > 0.5, layer[:, :3] * alpha, spread[:, :3])
    return torch.cat([colour, alpha], 1)
