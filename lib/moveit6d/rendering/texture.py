"""Textures at several resolutions, looked up at about one texel for each pixel.

Never knows cameras: the caller says how fine its pixels are.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from ..geometry.mesh import Mesh

MAX_ROWS = 30_000  # OpenCV's remap takes fewer than 2¹⁵ rows


class MipMap:
    """A mesh's texture and its halvings. Texels that no face uses do not bleed into used ones."""

    def __init__(self, mesh: Mesh) -> None:
        assert mesh.texture is not None and mesh.uv is not None
        self.wraps = bool(mesh.uv.min() < -1e-3 or mesh.uv.max() > 1 + 1e-3)
        covered = None if self.wraps else _covered(mesh.uv[mesh.faces], mesh.texture.shape[:2])
        self.levels = _pyramid(mesh.texture, covered)
        self.texels_per_metre = _density(mesh)

    def sample(self, uv: NDArray[np.float32], pixels_per_metre: float) -> NDArray[np.uint8]:
        """Colours (N, 3) at texture coordinates (N, 2), from the level nearest to the pixels."""
        import cv2

        ratio = self.texels_per_metre / max(pixels_per_metre, 1e-9)
        level = min(max(round(math.log2(max(ratio, 1e-9))), 0), len(self.levels) - 1)
        picture = self.levels[level]
        height, width = picture.shape[:2]
        if self.wraps:
            uv = uv - np.floor(uv)
        x = uv[:, :1] * np.float32(width) - np.float32(0.5)
        y = (1 - uv[:, 1:]) * np.float32(height) - np.float32(0.5)
        border = cv2.BORDER_WRAP if self.wraps else cv2.BORDER_REPLICATE
        parts = [
            cv2.remap(
                picture,
                x[k : k + MAX_ROWS],
                y[k : k + MAX_ROWS],
                cv2.INTER_LINEAR,
                borderMode=border,
            )[:, 0]
            for k in range(0, len(x), MAX_ROWS)
        ]
        return np.asarray(parts[0] if len(parts) == 1 else np.concatenate(parts), np.uint8)


def _density(mesh: Mesh) -> float:
    """Texels a metre of surface, on average over the area."""
    assert mesh.texture is not None and mesh.uv is not None
    height, width = mesh.texture.shape[:2]
    flat = mesh.uv[mesh.faces] * np.array([width, height], np.float32)  # (F, 3, 2)
    d1, d2 = flat[:, 1] - flat[:, 0], flat[:, 2] - flat[:, 0]
    texels = 0.5 * np.abs(d1[:, 0] * d2[:, 1] - d1[:, 1] * d2[:, 0]).sum()
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum()
    return math.sqrt(float(texels) / max(float(area), 1e-12))


def _covered(corners: NDArray[np.float32], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """1 for texels whose centre is in a face, else 0: corners (F, 3, 2) → (H, W).

    Faces may be smaller than a texel or mere points (palettes), so that the texels just inside of
    their corners count as well.
    """
    import cv2

    height, width = shape
    texels = np.stack([corners[..., 0] * width, (1 - corners[..., 1]) * height], -1)
    fine = np.zeros((3 * height, 3 * width), np.uint8)  # finer, as OpenCV fills outlines too
    for triangle in np.rint((3 * texels - 0.5) * 16).astype(np.int32):  # 4 bits of fraction
        cv2.fillConvexPoly(fine, triangle, 1, shift=4)
    covered = fine[1::3, 1::3].astype(np.float32)
    inner = (0.9 * texels + 0.1 * texels.mean(1, keepdims=True)).astype(np.int64)
    covered[inner[..., 1].clip(0, height - 1), inner[..., 0].clip(0, width - 1)] = 1
    return covered


def _pyramid(
    texture: NDArray[np.uint8], covered: NDArray[np.float32] | None
) -> list[NDArray[np.uint8]]:
    """The texture and its halvings down to a few texels, averaged over covered texels only."""
    import cv2

    height, width = texture.shape[:2]
    weight = np.ones((height, width), np.float32) if covered is None else covered
    colour = texture.astype(np.float32) * weight[..., None]  # times its weight
    colours, weights = [colour], [weight]
    while min(height, width) > 4:
        height, width = height // 2, width // 2
        colours.append(cv2.resize(colours[-1], (width, height), interpolation=cv2.INTER_AREA))
        weights.append(cv2.resize(weights[-1], (width, height), interpolation=cv2.INTER_AREA))
    levels: list[NDArray[np.uint8]] = []
    filler = None  # the next coarser level, for texels that nothing covers
    for colour, weight in zip(reversed(colours), reversed(weights), strict=True):
        size = weight.shape[1::-1]
        mean = colour / np.maximum(weight, 1e-6)[..., None]
        if filler is not None:
            empty = weight <= 0
            mean[empty] = cv2.resize(filler, size, interpolation=cv2.INTER_NEAREST)[empty]
        filler = mean
        levels.append(np.ascontiguousarray(np.rint(mean).clip(0, 255).astype(np.uint8)))
    return levels[::-1]
