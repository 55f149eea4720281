"""Light on a G-buffer: the one plain lamp under which the tracker sees its own renderings.

Never knows meshes or back ends; the lights of training live in `synthesis`.
"""

from __future__ import annotations

from torch import Tensor

from .renderer import GBuffer

AMBIENT = 0.45  # what a surface seen edge-on still shows, of 1 seen face-on


def shade_plain(buffer: GBuffer) -> Tensor:
    """RGB (B, 3, H, W) in [0, 1] under a lamp at the camera; the background is black."""
    facing = (-buffer.normal[:, 2:]).clamp(min=0)  # (B, 1, H, W)
    return buffer.albedo * (AMBIENT + (1 - AMBIENT) * facing)
