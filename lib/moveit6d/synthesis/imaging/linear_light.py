"""Linear light and display colours: the gamma curve and its inverse.

Never mixes pixels. What reaches a pixel from several surfaces, at an edge or in a blur, adds up as
light does, so that colours are made linear before anything is mixed.
"""

from __future__ import annotations

from torch import Tensor

GAMMA = 2.2  # of a usual display
BRIGHTEST = 1.5  # of full white: highlights beyond it are cut off


def to_linear(colour: Tensor, gamma: Tensor | float = GAMMA) -> Tensor:
    """Display colours (..., H, W) as amounts of light; `gamma` is a number or broadcasts.

    Examples:
        >>> import torch
        >>> round(float(to_linear(torch.tensor(0.5))), 3)
        0.218
    """
    return colour.clamp(0, BRIGHTEST) ** gamma


def to_display(light: Tensor, gamma: Tensor | float = GAMMA) -> Tensor:
    """Amounts of light (..., H, W), none below 0, as display colours: `to_linear` undone."""
    return light ** (1 / gamma)
