"""What a network answers for every cell, and the level at stride 2 that answers last.

Never solves for a pose.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn
from torch.nn import functional

from ..geometry.crop import PATCH_SIZE
from .blocks import conv_block
from .matching import centred, correlate_shifted, warp_cells


@dataclass(frozen=True)
class CellAnswer:
    """Answers a cell at one stride: displacement (B, 2, n, n) in pixels, logits (B, n, n).

    `shape` (B, 2, n, n), not at stride 8, says which direction is known well: see `precision`.
    """

    displacement: Tensor
    weight: Tensor
    visibility: Tensor
    shape: Tensor


def pool_cells(cells: CellAnswer) -> CellAnswer:
    """Means of 2 × 2 cells; they belong to the pixels of the coarser cells."""
    return CellAnswer(
        functional.avg_pool2d(cells.displacement, 2),
        functional.avg_pool2d(cells.weight[:, None], 2)[:, 0],
        functional.avg_pool2d(cells.visibility[:, None], 2)[:, 0],
        functional.avg_pool2d(cells.shape, 2),
    )


class FinestLevel(nn.Module):
    """Corrects the answers of stride 4 at stride 2; begins as no correction at all.

    Half a pixel at the outline is a percent of the object's distance: METHOD 9e, one level further.
    """

    def __init__(self, image: int, geometry: int, before: int, width: int, radius: int) -> None:
        super().__init__()
        self.radius = radius
        self.match = nn.Conv2d(image, width, 1)
        self.context = conv_block(before, width, 1, 1)
        offsets = (2 * radius + 1) ** 2
        self.mix = conv_block(offsets + 2 * width + geometry, width, 1, 1)
        self.decode = conv_block(width, width)
        self.answer = nn.Conv2d(width, 5, 1)
        nn.init.zeros_(self.answer.weight)
        nn.init.zeros_(self.answer.bias)  # type: ignore[arg-type]

    def forward(
        self, shared: Tensor, geometry: Tensor, hidden: Tensor, before: CellAnswer
    ) -> CellAnswer:
        """Answers at stride 2.

        `shared` (2 B, C, 64, 64) are features of the images and then of the renderings, `geometry`
        (B, G, 64, 64) the renderings', `hidden` (B, H, 32, 32) and `before` are those of stride 4.
        """
        batch = len(geometry)
        matched = centred(self.match(shared))
        image = functional.normalize(matched[:batch], dim=1)
        render = functional.normalize(matched[batch:], dim=1)
        start = _finer(before.displacement.detach())
        warped = warp_cells(image, start, PATCH_SIZE // image.shape[-1])
        correlation = correlate_shifted(render, warped, self.radius)
        context = functional.interpolate(self.context(hidden), scale_factor=2.0, mode="nearest")
        mixed = self.mix(torch.cat([correlation * 4, matched[batch:], geometry, context], 1))
        values = self.answer(self.decode(mixed))
        return CellAnswer(
            start + values[:, :2] * 2,
            _finer(before.weight[:, None])[:, 0] + values[:, 2],
            _finer(before.visibility[:, None])[:, 0],
            _finer(before.shape) + values[:, 3:],
        )


def _finer(cells: Tensor) -> Tensor:
    """Twice as many cells a side."""
    return functional.interpolate(cells, scale_factor=2.0, mode="bilinear", align_corners=False)
