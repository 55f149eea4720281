"""A texture in which every face has a small patch of its own, for looks that vary in two ways.

Never used where a picture or colours per vertex alone say how a part looks.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from .content import MeshPart
from .pictures import to_linear, to_srgb

MAX_SIDE = 4096
BORDER = 1  # texels around each patch
LEAST = 2 + 2 * BORDER  # side of a patch
BLOCK = 1 << 22  # texels that are worked on at once


def varies(part: MeshPart) -> bool:
    """Whether the colours of a part differ from vertex to vertex."""
    return part.colors is not None and bool((part.colors != part.colors[:1]).any())


def patch_side(part: MeshPart, largest: int | None = None, least: int = 0) -> int:
    """Texels a side of a face's patch in a texture of `largest` texels a side, where it is limited.

    At least `least`, if any texture can hold as many; 0 if the part has too many faces for one.
    """
    columns = math.ceil(math.sqrt(len(part.faces)))
    most = min(MAX_SIDE // columns, _natural(part))
    if most < LEAST:
        return 0
    return most if largest is None else min(most, max(largest // columns, least, LEAST))


def chart_shape(count: int, side: int) -> tuple[int, int]:
    """Height and width, texels, of the texture of so many faces with patches of `side` texels."""
    columns = math.ceil(math.sqrt(count))
    return math.ceil(count / columns) * side, columns * side


def charted(part: MeshPart, side: int) -> MeshPart:
    """The part with a texture made of its vertex colours, times its own texture if it has one.

    `side` (`patch_side`) is that of a patch, texels. Such a texture must not be reduced: averaging
    mixes the patches of different faces.
    """
    count = len(part.faces)
    weights = _weights(side)  # (S², 3)
    height, width = chart_shape(count, side)
    rows, columns = height // side, width // side
    patches = np.zeros((rows * columns, side * side, 3), np.uint8)
    step = max(1, BLOCK // (side * side))
    for start in range(0, count, step):
        patches[start : start + step][: len(part.faces[start : start + step])] = _painted(
            part, part.faces[start : start + step], weights
        )
    texture = patches.reshape(rows, columns, side, side, 3).swapaxes(1, 2)
    texture = texture.reshape(height, width, 3)
    return MeshPart(
        part.vertices[part.faces.reshape(-1)],
        np.arange(3 * count).reshape(-1, 3),
        _coordinates(count, columns, side, width, height),
        np.ascontiguousarray(texture),
    )


def _natural(part: MeshPart) -> int:
    """The patch side at which the finest face of the part's own texture loses nothing."""
    if part.texture is None or part.uv is None:
        return 16
    size = np.array([part.texture.shape[1], part.texture.shape[0]])
    corners = part.uv[part.faces] * size
    extent = float((corners.max(1) - corners.min(1)).max())
    return int(min(max(extent, 1), MAX_SIDE)) + LEAST


def _weights(side: int) -> NDArray[np.float64]:
    """Barycentric weights (S², 3) of the texels of a patch; beyond the face, those of its edge."""
    line = ((np.arange(side) - BORDER) / (side - 1 - 2 * BORDER)).clip(0, 1)
    v, u = np.meshgrid(line, line, indexing="ij")
    over = np.maximum(u + v, 1.0)
    u, v = u / over, v / over
    return np.stack([1 - u - v, u, v], -1).reshape(-1, 3)


def _painted(
    part: MeshPart, faces: NDArray[np.int64], weights: NDArray[np.float64]
) -> NDArray[np.uint8]:
    """Colours (F, S², 3) of the patches of some faces."""
    light = np.ones((len(faces), len(weights), 3))
    if part.colors is not None:
        if part.texture is None:  # as between vertices elsewhere: bytes, not light
            mixed = np.einsum("sk,fkc->fsc", weights, part.colors[faces].astype(np.float64))
            return np.asarray(np.rint(mixed), np.uint8)
        light = np.einsum("sk,fkc->fsc", weights, to_linear(part.colors)[faces])
    assert part.texture is not None and part.uv is not None
    uv = np.einsum("sk,fkc->fsc", weights, part.uv[faces].astype(np.float64))
    return to_srgb(light * to_linear(sampled(part.texture, uv, part.wrap)))


def sampled(
    texture: NDArray[np.uint8], uv: NDArray[np.float64], wrap: tuple[str, str]
) -> NDArray[np.uint8]:
    """Colours of the nearest texels at texture coordinates (..., 2), v up."""
    height, width = texture.shape[:2]
    u, v = _wrapped(uv[..., 0], wrap[0]), _wrapped(uv[..., 1], wrap[1])
    x = (u * width).astype(np.int64).clip(0, width - 1)
    y = ((1 - v) * height).astype(np.int64).clip(0, height - 1)
    return np.asarray(texture[y, x])


def _wrapped(value: NDArray[np.float64], wrap: str) -> NDArray[np.float64]:
    if wrap == "clamp":
        return value.clip(0, 1)
    if wrap == "mirror":
        return 1 - np.abs(value % 2 - 1)
    inside = (value >= 0) & (value <= 1)
    return np.where(inside, value, value % 1)


def _coordinates(
    count: int, columns: int, side: int, width: int, height: int
) -> NDArray[np.float32]:
    """Texture coordinates (3F, 2) of the corners: centres of texels at the patches' edges."""
    row, column = np.divmod(np.arange(count), columns)
    reach = side - 1 - 2 * BORDER
    offsets = np.array([[0, 0], [reach, 0], [0, reach]]) + BORDER + 0.5
    x = (column[:, None] * side + offsets[:, 0]) / width
    y = (row[:, None] * side + offsets[:, 1]) / height
    return np.stack([x, 1 - y], -1).reshape(-1, 2).astype(np.float32)


def per_vertex(part: MeshPart) -> NDArray[np.uint8]:
    """Colours (V, 3) of a part at its vertices alone: its own, times its texture's texels there."""
    if part.colors is not None and part.texture is None:
        return part.colors
    light = np.ones((len(part.vertices), 3))
    if part.colors is not None:
        light = to_linear(part.colors)
    if part.texture is not None and part.uv is not None:
        light = light * to_linear(sampled(part.texture, part.uv.astype(np.float64), part.wrap))
    return to_srgb(light)
