"""Where the contour really is along each correspondence line: a distribution per line.

Never knows poses. SRT3D, section 3: smoothed step functions for what is inside and outside,
compared with the pixels' colours at every distance.
"""

from __future__ import annotations

import numpy as np

from ..config import ContourConfig
from ..typing import Float32, Float64


def contour_distances(
    log_odds: Float32, points: Float64, normals: Float64, scale: int, config: ContourConfig
) -> tuple[Float64, Float64]:
    """Mean and variance (N,), pixels, of how far along its normal each point should move.

    `log_odds` (H, W) as in `ColourHistograms.log_odds`; a segment is `scale` pixels long. Where
    colours say nothing every distance is equally likely: mean 0 and a large variance.
    """
    likelihood = np.log(_likelihood(_segments(log_odds, points, normals, scale, config), config))
    total = likelihood.sum(-1, dtype=np.float64)
    chance = np.exp(total - total.max(1, keepdims=True))
    chance /= chance.sum(1, keepdims=True)
    distances = np.arange(-config.reach, config.reach + 1)
    mean = chance @ distances
    variance = chance @ distances**2 - mean**2
    return mean * scale, np.maximum(variance, config.min_deviation**2) * scale**2


def _segments(
    log_odds: Float32, points: Float64, normals: Float64, scale: int, config: ContourConfig
) -> Float32:
    """How likely each segment is the object's, from the inside out: (N, 2·(reach + window))."""
    import cv2

    count = 2 * (config.reach + config.window)
    along = np.arange(count * scale) - (count * scale - 1) / 2
    place = (points[:, :, None] + normals[:, :, None] * along).astype(np.float32)
    odds = cv2.remap(
        log_odds, place[:, 0], place[:, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
    )
    share: Float32 = 1 / (1 + np.exp(-odds.reshape(len(points), count, scale).sum(-1)))
    return share


def _likelihood(share: Float32, config: ContourConfig) -> Float32:
    """Of what each segment near each distance shows: (N, 2·reach + 1, 2·window)."""
    count = 2 * config.window
    place = np.arange(count) + 0.5 - config.window
    step = np.float32(0.5 - config.amplitude * np.tanh(place / (2 * config.slope)))
    near = np.lib.stride_tricks.sliding_window_view(share, count, axis=1)
    likelihood: Float32 = near * (2 * step - 1) + (1 - step)
    return likelihood
