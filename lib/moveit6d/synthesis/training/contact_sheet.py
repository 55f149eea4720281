"""A contact sheet of training pairs: the network's inputs and the truth.

Never draws pairs itself.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ..imaging.layers import blend
from ..imaging.sensor import to_bytes
from .pairs import TrainingBatch

GAP = 6  # pixels between pairs
# Colours of the two outlines, and of the mask's parts: (3, 1, 1).
TRUTH, START, SEEN, HIDDEN = torch.tensor(
    [[0.2, 1.0, 0.3], [1.0, 0.35, 0.2], [1.0, 1.0, 1.0], [0.55, 0.1, 0.1]]
)[..., None, None]


def contact_sheet(batch: TrainingBatch, across: int = 2) -> NDArray[np.uint8]:
    """A picture (H, W, 3) with `across` pairs a row, four crops each.

    They are the observation, the rendering, the observation with the contours of the true
    pose (green) and of the start (red), and the object's mask: white where it can be seen, dark red
    where it is occluded.
    """
    seen = batch.observation
    marked = blend(seen.image, START, _outline(seen.mask))
    marked = blend(marked, TRUTH, _outline(batch.true_mask))
    mask = blend(torch.zeros_like(seen.image), HIDDEN, batch.true_mask)
    mask = blend(mask, SEEN, batch.visible)
    pairs = torch.cat([seen.image, seen.rendering, marked, mask], -1)  # (B, 3, 128, 512)
    pairs = functional.pad(pairs, (GAP, GAP, GAP, GAP), value=0.5)
    rest = -len(pairs) % across
    pairs = torch.cat([pairs, torch.full((rest, *pairs.shape[1:]), 0.5)])
    rows = [torch.cat(list(pairs[k : k + across]), -1) for k in range(0, len(pairs), across)]
    sheet = torch.cat(rows, -2).permute(1, 2, 0)
    return to_bytes(sheet).numpy()


def _outline(mask: Tensor) -> Tensor:
    """The object's side of its silhouette's edge (B, 1, H, W)."""
    return mask - -functional.max_pool2d(-mask, 3, 1, 1)
