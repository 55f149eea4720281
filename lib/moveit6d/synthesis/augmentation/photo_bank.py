"""Photographs as one tensor, of which random squares are cut in batches on any device.

Never reads a file.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from torch import Tensor

from .random_source import RandomSource

SMALLEST = 48  # pixels: side of the smallest square that is cut


class PhotoBank:
    """Photographs (H, W, 3) uint8 of any sizes."""

    def __init__(self, photos: Sequence[np.ndarray], device: torch.device) -> None:
        sizes = np.array([photo.shape[:2] for photo in photos])
        first = np.concatenate([[0], np.cumsum(sizes.prod(1))[:-1]])
        self.pixels = torch.from_numpy(np.concatenate([p.reshape(-1, 3) for p in photos])).to(
            device
        )
        self.first = torch.from_numpy(first).to(device)
        self.height, self.width = torch.from_numpy(sizes).to(device).unbind(1)

    def squares(self, count: int, size: int, rng: RandomSource) -> Tensor:
        """Random squares of random photos, mirrored half of the time: (count, 3, size, size)."""
        chosen = rng.integers(count, below=len(self.first))
        height, width = self.height[chosen], self.width[chosen]
        most = torch.minimum(height, width).float()
        least = most.clamp_max(SMALLEST)
        share = rng.uniform(4, count)
        side = (least + share[0] * (most - least + 1)).floor().clamp_max(most)
        left, top = share[1] * (width - side), share[2] * (height - side)
        line = (rng.arange(size) + 0.5) / size  # (size,)
        across = torch.where(share[3, :, None] < 0.5, line, 1 - line)
        x = (left[:, None] + across * side[:, None] - 0.5).clamp_min(0)
        y = (top[:, None] + line * side[:, None] - 0.5).clamp_min(0)
        x = torch.minimum(x, width[:, None] - 1.0)
        y = torch.minimum(y, height[:, None] - 1.0)
        x0, y0 = x.floor().long(), y.floor().long()
        x1 = torch.minimum(x0 + 1, width[:, None] - 1)
        y1 = torch.minimum(y0 + 1, height[:, None] - 1)
        dx, dy = (
            (x - x0)[:, None, :, None],
            (y - y0)[:, :, None, None],
        )  # (B, 1, N, 1), (B, N, 1, 1)
        upper, lower = (
            (self.first[chosen, None] + row * width[:, None])[:, :, None] for row in (y0, y1)
        )
        x0, x1 = x0[:, None], x1[:, None]
        picture = (self._at(upper + x0) * (1 - dx) + self._at(upper + x1) * dx) * (1 - dy)
        picture += (self._at(lower + x0) * (1 - dx) + self._at(lower + x1) * dx) * dy
        return picture.permute(0, 3, 1, 2).contiguous() / 255

    def _at(self, index: Tensor) -> Tensor:
        """Colours (B, N, N, 3) of pixels (B, N, N)."""
        return self.pixels[index].float()
