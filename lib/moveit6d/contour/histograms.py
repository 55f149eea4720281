"""Which colours are the object's and which are those around it: two histograms.

Never knows poses or meshes.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..config import ContourConfig
from ..typing import Float32, Mask, RGBImage


@dataclass(frozen=True)
class ColourHistograms:
    """Densities (bins³,) of colours on the object and beside it; each sums to 1."""

    inside: Float32
    outside: Float32

    def blend(self, new: ColourHistograms, rate: float) -> ColourHistograms:
        """These colours, a part `rate` of them forgotten for the new ones."""
        return ColourHistograms(
            self.inside + np.float32(rate) * (new.inside - self.inside),
            self.outside + np.float32(rate) * (new.outside - self.outside),
        )

    def log_odds(self, patch: RGBImage, seen: Mask, config: ContourConfig) -> Float32:
        """Logarithm of how much likelier each pixel (H, W, 3) is the object's: (H, W).

        Both are as likely before its colour is known. 0 where nothing is `seen` (H, W).
        """
        share = (self.inside + config.rare) / (self.inside + self.outside + 2 * config.rare)
        share = config.pixel_error + (1 - 2 * config.pixel_error) * share
        table = np.log(share / (1 - share)).astype(np.float32)
        odds: Float32 = np.where(seen, table[colour_bins(patch, config.bins)], np.float32(0))
        return odds


def estimate_histograms(
    patch: RGBImage, mask: Mask, seen: Mask, config: ContourConfig
) -> ColourHistograms | None:
    """The colours of a patch (H, W, 3) in the bands along the outline of a mask (H, W).

    Only pixels that are `seen` (H, W) count; None if there are too few on either side.
    """
    import cv2

    inner, outer = mask.astype(np.uint8), (~mask).astype(np.uint8)
    bands = [
        (side > 0) & seen & (cv2.distanceTransform(side, cv2.DIST_L2, 3) <= config.band)
        for side in (inner, outer)
    ]
    if min(int(band.sum()) for band in bands) < config.min_pixels:
        return None
    bins = colour_bins(patch, config.bins)
    inside, outside = (_density(bins[band], config) for band in bands)
    return ColourHistograms(inside, outside)


def colour_bins(patch: RGBImage, count: int) -> NDArray[np.int32]:
    """The bin of each pixel, `count` a channel: (..., 3) → (...)."""
    r, g, b = np.moveaxis(patch.astype(np.int32) * count >> 8, -1, 0)
    bins: NDArray[np.int32] = (r * count + g) * count + b
    return bins


def _density(bins: NDArray[np.int32], config: ContourConfig) -> Float32:
    """How common each colour is, blurred in all three channels."""
    n, blur = config.bins, _blur_matrix(config.bins, config.bin_blur)
    counts = np.bincount(bins, minlength=n**3).astype(np.float32)
    # By torch, whose threads are limited; NumPy's wait for each other where cores are busy.
    cube = (blur @ torch.from_numpy(counts).reshape(n, -1)).reshape(n, n, n)
    cube = blur @ cube @ blur.mT
    return np.asarray(cube.reshape(-1) / len(bins), np.float32)


@cache
def _blur_matrix(bins: int, width: float) -> Tensor:
    """Gaussian blur of so many values as a matrix whose columns sum to 1: nothing gets lost."""
    line = np.arange(bins)
    matrix = np.exp(-0.5 * ((line[:, None] - line) / width) ** 2)
    # Tails of denormal numbers change nothing and make the products five times slower.
    matrix[matrix < 1e-8] = 0
    return torch.from_numpy(np.asarray(matrix / matrix.sum(0), np.float32))
