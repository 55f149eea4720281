"""Light on a G-buffer: the one plain lamp under which the tracker sees its own renderings.

Never knows meshes or back ends; the lights of training live in `synthesis`.
"""

from __future__ import annotations

from torch import Tensor

from ..geometry.projected_texture import AMBIENT
from .renderer import GBuffer


def shade_plain(buffer: GBuffer) -> Tensor:
    """RGB (B, 3, H, W) in [0, 1] under a lamp at the camera; the background is black."""
    facing = (-buffer.normal[:, 2:]).clamp(min=0)  # (B, 1, H, W)
    return buffer.albedo * (AMBIENT + (1 - AMBIENT) * facing)
