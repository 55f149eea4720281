"""The contour of a rendered mask: where it runs and which way is out.

Never sees an image.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..typing import Float64, Mask


@dataclass(frozen=True)
class Contour:
    """Points (N, 2) between the last pixel inside and the first outside, x and y in the patch.

    `normals` (N, 2) are unit and point out; `inside` (N, 2) are the pixels (row, column) just
    inside; `lengths` (N,) say how much of the contour each point stands for, 1 on average.
    """

    points: Float64
    normals: Float64
    inside: NDArray[np.intp]
    lengths: Float64


def find_contour(mask: Mask, number: int, blur: float) -> Contour | None:
    """At most `number` points along the contours of a mask (H, W), holes included; None if none.

    Directions are averaged over `blur` pixels. The true contour crosses the grid anywhere between
    two neighbours, so that the middle between them is right on average, to a fraction of a pixel
    over all points.
    """
    import cv2

    points, inside = _borders(mask)
    if not len(points):
        return None
    chosen = np.unique(np.linspace(0, len(points) - 1, number).round().astype(int))
    points, inside = points[chosen], inside[chosen]
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), blur)
    row, column = inside.T
    slopes = [cv2.Sobel(soft, cv2.CV_32F, *axis, ksize=3)[row, column] for axis in ((1, 0), (0, 1))]
    normals = -np.stack(slopes, -1).astype(np.float64)
    steep = np.linalg.norm(normals, axis=1)
    good = steep > 1e-3  # a line one pixel wide has no outside
    if not good.any():
        return None
    normals = normals[good] / steep[good, None]
    # An oblique contour has more borders of pixels than it has length.
    lengths = 1 / np.abs(normals).sum(1)
    return Contour(points[good], normals, inside[good], lengths / lengths.mean())


def _borders(mask: Mask) -> tuple[Float64, NDArray[np.intp]]:
    """Middles (N, 2) between neighbours of which one is inside, and the pixels inside (N, 2)."""
    points, inside = [], []
    for down, right in ((0, 1), (1, 0)):
        first = mask[: mask.shape[0] - down, : mask.shape[1] - right]
        second = mask[down:, right:]
        row, column = np.nonzero(first != second)
        points.append(np.stack([column + right / 2, row + down / 2], -1))
        later = second[row, column]  # is it the second of the two that is inside?
        inside.append(np.stack([row + down * later, column + right * later], -1))
    return np.concatenate(points), np.concatenate(inside)
