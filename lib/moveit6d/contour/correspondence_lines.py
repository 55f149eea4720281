"""Where the contour really is along each correspondence line: a distribution per line.

Never knows poses. SRT3D, section 3: smoothed step functions for what is inside and outside,
compared with the pixels' colours at every displacement.
"""

from __future__ import annotations

import numpy as np

from ..typing import Float32, Float64

REACH = 6  # displacements each way, in segments of the line
WINDOW = 4  # segments each side of a displacement that it is judged by
# The chance that a pixel of the line is the object's goes from 0.5 + AMPLITUDE far inside to
# 0.5 − AMPLITUDE far outside; SLOPE is in segments.
AMPLITUDE = 0.36
SLOPE = 0.8
SHARPEST = 0.7  # segments: no line knows better where the object ends


def contour_distances(
    log_odds: Float32, points: Float64, normals: Float64, scale: int
) -> tuple[Float64, Float64]:
    """Mean and variance (N,), pixels, of how far along its normal each point should move.

    `log_odds` (H, W) as in `ColourHistograms.log_odds`; a segment is `scale` pixels long. Where
    colours say nothing every distance is equally likely: mean 0 and a large variance.
    """
    likelihood = np.log(_likelihood(_segments(log_odds, points, normals, scale)))
    total = likelihood.sum(-1, dtype=np.float64)
    chance = np.exp(total - total.max(1, keepdims=True))
    chance /= chance.sum(1, keepdims=True)
    steps = np.arange(-REACH, REACH + 1)
    mean = chance @ steps
    variance = chance @ steps**2 - mean**2
    return mean * scale, np.maximum(variance, SHARPEST**2) * scale**2


def _segments(log_odds: Float32, points: Float64, normals: Float64, scale: int) -> Float32:
    """How likely each segment is the object's, from the inside out: (N, 2·(REACH + WINDOW))."""
    import cv2

    count = 2 * (REACH + WINDOW)
    along = np.arange(count * scale) - (count * scale - 1) / 2
    place = (points[:, :, None] + normals[:, :, None] * along).astype(np.float32)
    odds = cv2.remap(
        log_odds, place[:, 0], place[:, 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT
    )
    share: Float32 = 1 / (1 + np.exp(-odds.reshape(len(points), count, scale).sum(-1)))
    return share


def _likelihood(share: Float32) -> Float32:
    """Of what each segment near each displacement shows: (N, 2·REACH + 1, 2·WINDOW)."""
    place = np.arange(2 * WINDOW) + 0.5 - WINDOW
    step = np.float32(0.5 - AMPLITUDE * np.tanh(place / (2 * SLOPE)))
    near = np.lib.stride_tricks.sliding_window_view(share, 2 * WINDOW, axis=1)
    likelihood: Float32 = near * (2 * step - 1) + (1 - step)
    return likelihood
