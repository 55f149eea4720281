"""A contact sheet of training pairs: the network's inputs and the truth.

Never draws pairs itself.
"""

from __future__ import annotations

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from .pairs import TrainingBatch

GAP = 6  # pixels between pairs
TRUTH, START = (0.2, 1.0, 0.3), (1.0, 0.35, 0.2)  # colours of the two outlines
SEEN, HIDDEN = (1.0, 1.0, 1.0), (0.55, 0.1, 0.1)  # of the mask's parts


def contact_sheet(batch: TrainingBatch, across: int = 2) -> NDArray[np.uint8]:
    """A picture (H, W, 3) with `across` pairs a row, four crops each.

    They are the observation, the rendering, the observation with the contours of the true
    pose (green) and of the start (red), and the object's mask: white where it can be seen, dark red
    where it is occluded.
    """
    seen = batch.observation
    marked = _painted(seen.image, _outline(seen.mask), START)
    marked = _painted(marked, _outline(batch.true_mask), TRUTH)
    mask = _painted(torch.zeros_like(seen.image), batch.true_mask, HIDDEN)
    mask = _painted(mask, batch.visible, SEEN)
    pairs = torch.cat([seen.image, seen.rendering, marked, mask], -1)  # (B, 3, 128, 512)
    pairs = functional.pad(pairs, (GAP, GAP, GAP, GAP), value=0.5)
    rest = -len(pairs) % across
    pairs = torch.cat([pairs, torch.full((rest, *pairs.shape[1:]), 0.5)])
    rows = [torch.cat(list(pairs[k : k + across]), -1) for k in range(0, len(pairs), across)]
    sheet = torch.cat(rows, -2).permute(1, 2, 0)
    return (sheet.clamp(0, 1) * 255).round().byte().numpy()


def _outline(mask: Tensor) -> Tensor:
    """The object's side of its silhouette's edge (B, 1, H, W)."""
    return mask - -functional.max_pool2d(-mask, 3, 1, 1)


def _painted(picture: Tensor, where: Tensor, colour: tuple[float, float, float]) -> Tensor:
    tint = torch.tensor(colour)[None, :, None, None]
    return picture + (tint - picture) * where
