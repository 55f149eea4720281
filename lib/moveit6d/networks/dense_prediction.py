"""What a network answers for every cell.

Never computes anything.
"""

from __future__ import annotations

from dataclasses import dataclass

from torch import Tensor


@dataclass(frozen=True)
class DensePrediction:
    """Answers a cell at one stride: displacement (B, 2, n, n) in pixels, logits (B, n, n).

    `shape` (B, 2, n, n), not at stride 8, says which direction is known well: see `precision`.
    """

    displacement: Tensor
    weight: Tensor
    visibility: Tensor
    shape: Tensor
