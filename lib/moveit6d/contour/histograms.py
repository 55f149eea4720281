"""Which colours are the object's and which are those around it: two histograms.

Never knows poses or meshes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..typing import Float32, Mask, RGBImage

BINS = 32  # a channel
BLUR = 1.0  # bins: colours that nobody has seen yet lie beside colours that were
BAND = 16  # pixels inside and outside of the outline whose colours are learnt
ENOUGH = 30  # pixels on either side without which nothing is learnt
RARE = 1e-6  # density under which a colour says nothing
SUREST = 0.02  # what a single pixel may be wrong with at least


@dataclass(frozen=True)
class ColourHistograms:
    """Densities (BINS³,) of colours on the object and beside it; each sums to 1."""

    inside: Float32
    outside: Float32

    def blend(self, new: ColourHistograms, rate: float) -> ColourHistograms:
        """These colours, a part `rate` of them forgotten for the new ones."""
        return ColourHistograms(
            self.inside + np.float32(rate) * (new.inside - self.inside),
            self.outside + np.float32(rate) * (new.outside - self.outside),
        )

    def log_odds(self, patch: RGBImage, seen: Mask) -> Float32:
        """Logarithm of how much likelier each pixel (H, W, 3) is the object's: (H, W).

        Both are as likely before its colour is known. 0 where nothing is `seen` (H, W).
        """
        share = (self.inside + RARE) / (self.inside + self.outside + 2 * RARE)
        share = SUREST + (1 - 2 * SUREST) * share
        table = np.log(share / (1 - share)).astype(np.float32)
        odds: Float32 = np.where(seen, table[colour_bins(patch)], np.float32(0))
        return odds


def estimate_histograms(patch: RGBImage, mask: Mask, seen: Mask) -> ColourHistograms | None:
    """The colours of a patch (H, W, 3) in the bands along the outline of a mask (H, W).

    Only pixels that are `seen` (H, W) count; None if there are too few on either side.
    """
    import cv2

    inner, outer = mask.astype(np.uint8), (~mask).astype(np.uint8)
    bands = [
        (side > 0) & seen & (cv2.distanceTransform(side, cv2.DIST_L2, 3) <= BAND)
        for side in (inner, outer)
    ]
    if min(int(band.sum()) for band in bands) < ENOUGH:
        return None
    bins = colour_bins(patch)
    return ColourHistograms(_density(bins[bands[0]]), _density(bins[bands[1]]))


def colour_bins(patch: RGBImage) -> NDArray[np.int32]:
    """The bin of each pixel: (..., 3) → (...)."""
    r, g, b = np.moveaxis(patch.astype(np.int32) * BINS >> 8, -1, 0)
    bins: NDArray[np.int32] = (r * BINS + g) * BINS + b
    return bins


def _density(bins: NDArray[np.int32]) -> Float32:
    """How common each colour is, blurred in all three channels."""
    counts = np.bincount(bins, minlength=BINS**3).astype(np.float32)
    # By torch, whose threads are limited; NumPy's wait for each other where cores are busy.
    cube = (_BLUR @ torch.from_numpy(counts).reshape(BINS, -1)).reshape(BINS, BINS, BINS)
    cube = _BLUR @ cube @ _BLUR.mT
    return np.asarray(cube.reshape(-1) / len(bins), np.float32)


def _blur_matrix() -> Tensor:
    """Gaussian blur of BINS values as a matrix whose columns sum to 1: nothing gets lost."""
    line = np.arange(BINS)
    matrix = np.exp(-0.5 * ((line[:, None] - line) / BLUR) ** 2)
    # Tails of denormal numbers change nothing and make the products five times slower.
    matrix[matrix < 1e-8] = 0
    return torch.from_numpy(np.asarray(matrix / matrix.sum(0), np.float32))


_BLUR = _blur_matrix()
