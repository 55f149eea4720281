"""Alpha masks as geometry: the parts of faces that a mask makes invisible are cut away.

Never blends: what a mask does not hide is solid.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .content import MeshPart

FINEST = 256  # cells a side that a mask is reduced to
MOST_FACES = 300_000  # further cuts are left out

Corners = NDArray[np.float64]


def cut_out(part: MeshPart, alpha: NDArray[np.uint8], cutoff: float) -> MeshPart:
    """The part without what lies where `alpha` (H, W) is below `cutoff` (0 to 255).

    Faces at the mask's edge are quartered until they are as small as the mask's cells.
    """
    assert part.uv is not None
    solid = _reduced(alpha) >= cutoff
    if solid.all():
        return part
    sums = np.pad(np.cumsum(np.cumsum(solid.astype(np.int64), 0), 1), ((1, 0), (1, 0)))
    height, width = solid.shape
    size = np.array([width, height], np.float64)
    tables: list[NDArray[Any]] = [part.vertices, part.uv]
    if part.colors is not None:
        tables.append(part.colors)
    values = np.concatenate([table.astype(np.float64) for table in tables], 1)
    corners: Corners = values[part.faces]  # (F, 3, C)
    kept: list[Corners] = []
    for _ in range(20):
        if not len(corners):
            break
        flat = np.stack([corners[..., 3], 1 - corners[..., 4]], -1) * size  # (F, 3, 2) cells
        seen, extent = _solid_share(flat, sums, size)
        kept.append(corners[seen == 1])
        mixed = corners[(seen > 0) & (seen < 1) & (extent > 1)]
        small = (seen > 0) & (seen < 1) & (extent <= 1)
        if len(mixed) * 4 + sum(map(len, kept)) > MOST_FACES:
            small, mixed = (seen > 0) & (seen < 1), mixed[:0]
        middle = np.floor(flat[small].mean(1)).astype(np.int64) % size.astype(np.int64)
        kept.append(corners[small][solid[middle[:, 1], middle[:, 0]]])
        corners = _quartered(mixed)
    return _part(part, np.concatenate(kept))


def _solid_share(
    flat: Corners, sums: NDArray[np.int64], size: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """How much of the rectangle of cells around each triangle is solid, and its longer side."""
    shift = np.floor(flat.min(1, keepdims=True) / size + 1e-9) * size  # the tile that repeats
    low = np.floor(flat.min(1) - shift[:, 0] + 1e-6).astype(np.int64)
    high = np.ceil(flat.max(1) - shift[:, 0] - 1e-6).astype(np.int64)
    high = np.maximum(high, low + 1)
    whole = size.astype(np.int64)
    across = (high > whole).any(1)  # reaches into the next tile: to be cut first
    low, high = np.clip(low, 0, whole - 1), np.clip(high, 1, whole)
    count = (
        sums[high[:, 1], high[:, 0]] - sums[low[:, 1], high[:, 0]]
        - sums[high[:, 1], low[:, 0]] + sums[low[:, 1], low[:, 0]]
    )  # fmt: skip
    share = count / np.maximum((high - low).prod(1), 1)
    mixed = 0.0 < sums[-1, -1] < whole.prod()
    share = np.where(across & mixed, 0.5, share)
    return share, (flat.max(1) - flat.min(1)).max(1)


def _quartered(corners: Corners) -> Corners:
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    ab, bc, ca = (a + b) / 2, (b + c) / 2, (c + a) / 2
    quarters = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    return np.concatenate([np.stack(quarter, 1) for quarter in quarters])


def _part(part: MeshPart, corners: Corners) -> MeshPart:
    flat = corners.reshape(-1, corners.shape[-1])
    values, faces = np.unique(flat, axis=0, return_inverse=True)
    colors = None if part.colors is None else np.rint(values[:, 5:]).astype(np.uint8)
    return MeshPart(
        values[:, :3], faces.reshape(-1, 3), values[:, 3:5].astype(np.float32), part.texture,
        colors, part.color, part.wrap,
    )  # fmt: skip


def _reduced(alpha: NDArray[np.uint8]) -> NDArray[np.uint8]:
    from PIL import Image

    scale = FINEST / max(alpha.shape)
    if scale >= 1:
        return alpha
    size = (max(1, round(alpha.shape[1] * scale)), max(1, round(alpha.shape[0] * scale)))
    return np.asarray(Image.fromarray(alpha).resize(size, Image.Resampling.BOX), np.uint8)
