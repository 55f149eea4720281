"""Several parts with different looks as one surface with one texture or a colour per vertex.

Never reads files and never changes the shape.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from .charts import charted, sampled
from .content import MeshPart
from .pictures import tinted, to_linear

PLAIN = (160, 160, 160)  # a surface without any colour of its own
MAX_ATLAS = 4096
GUTTER = 8  # pixels around each tile of an atlas, so that tiles do not bleed into each other
MAX_REPEATS = 1024  # of a texture within one face; more are finer than any pixel
PADDING = {"repeat": "wrap", "mirror": "symmetric", "clamp": "edge"}


@dataclass
class Surface:
    """Triangles with colour. Exactly one of `texture` (with `uv`, v up) and `colors` is set."""

    vertices: NDArray[np.float64]  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3)
    uv: NDArray[np.float32] | None = None  # (V, 2)
    texture: NDArray[np.uint8] | None = None  # (H, W, 3)
    colors: NDArray[np.uint8] | None = None  # (V, 3)


def join(parts: list[MeshPart]) -> Surface:
    """All parts as one surface, their textures packed into one atlas.

    A texture that repeats is laid out as often as its faces need. A part whose colours vary from
    vertex to vertex gets a patch of the atlas for each face if other parts have textures.
    """
    parts = [_single(part) for part in parts]
    pictures = {
        None if p.texture is None else (p.texture.shape, p.texture.tobytes()) for p in parts
    }
    if pictures == {None}:
        return _colored(parts)
    if len(pictures) == 1 and all(part.wrap == ("repeat", "repeat") for part in parts):
        return _textured(parts, parts[0].texture)
    parts = [_flat(part) for part in parts]
    if any(part.texture is None and _varies(part) for part in parts):
        parts = [charted(p) if p.texture is None and _varies(p) else p for p in parts]
        if any(part.texture is None and _varies(part) for part in parts):  # too many faces
            return _colored(parts)
    if len(parts) == 1 and parts[0].texture is not None:
        return _textured(parts, parts[0].texture)
    texture, coordinates = _atlas(parts)
    surface = _geometry(parts)
    surface.texture, surface.uv = texture, coordinates
    return surface


def _single(part: MeshPart) -> MeshPart:
    """The part with a texture or colours, not both."""
    if part.texture is None or part.uv is None:
        colors = part.colors
        if colors is None:
            color = PLAIN if part.color is None else part.color
            colors = np.tile(np.asarray(color, np.uint8), (len(part.vertices), 1))
        return MeshPart(part.vertices, part.faces, colors=colors)
    if part.colors is None:
        return part
    if not _varies(part):
        texture = tinted(part.texture, to_linear(part.colors[0]))
        return MeshPart(part.vertices, part.faces, part.uv, texture, wrap=part.wrap)
    return charted(part)


def _varies(part: MeshPart) -> bool:
    return part.colors is not None and bool((part.colors != part.colors[:1]).any())


def _geometry(parts: list[MeshPart]) -> Surface:
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Surface(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
    )


def _textured(parts: list[MeshPart], texture: NDArray[np.uint8] | None) -> Surface:
    surface = _geometry(parts)
    surface.texture = texture
    surface.uv = np.concatenate([part.uv for part in parts if part.uv is not None])
    return surface


def _colored(parts: list[MeshPart]) -> Surface:
    surface = _geometry(parts)
    surface.colors = np.concatenate([_vertex_colors(part) for part in parts])
    return surface


def _flat(part: MeshPart) -> MeshPart:
    """The part with texture coordinates in [0, 1]: what repeats is laid out in its texture."""
    if part.texture is None or part.uv is None:
        return part
    if part.uv.min() >= -1e-3 and part.uv.max() <= 1 + 1e-3:
        return MeshPart(part.vertices, part.faces, part.uv.clip(0, 1), part.texture)
    corners = part.uv[part.faces].astype(np.float64)  # (F, 3, 2)
    shift = np.zeros((len(part.faces), 2), np.int64)  # whole tiles that a face can be moved by
    for axis, wrap in enumerate(part.wrap):
        period = {"repeat": 1, "mirror": 2, "clamp": 0}[wrap]
        if period:
            lowest = corners[..., axis].min(1)
            shift[:, axis] = np.floor(lowest / period + 1e-4).astype(np.int64) * period
    moved = corners - shift[:, None]
    low = np.floor(moved.min((0, 1)) + 1e-3).astype(np.int64).clip(max=0)
    high = np.ceil(moved.max((0, 1)) - 1e-3).astype(np.int64).clip(min=1)
    if (high - low).prod() > MAX_REPEATS:
        mean = part.texture.reshape(-1, 3).mean(0)
        colors = np.tile(np.rint(mean).astype(np.uint8), (len(part.vertices), 1))
        return MeshPart(part.vertices, part.faces, colors=colors)
    texture = _laid_out(part.texture, low, high, part.wrap)
    key = np.concatenate(
        [part.faces.reshape(-1, 1), np.repeat(shift, 3, axis=0)], 1
    )  # corners of a vertex that are moved alike stay one vertex
    _, first, faces = np.unique(key, axis=0, return_index=True, return_inverse=True)
    uv = ((moved - low) / (high - low)).reshape(-1, 2)[first].clip(0, 1)
    vertices = part.vertices[part.faces.reshape(-1)[first]]
    return MeshPart(vertices, faces.reshape(-1, 3), uv.astype(np.float32), texture)


def _laid_out(
    texture: NDArray[np.uint8], low: NDArray[np.int64], high: NDArray[np.int64],
    wrap: tuple[str, str],
) -> NDArray[np.uint8]:  # fmt: skip
    """The texture continued over the tiles from `low` to `high` (u, v), v up."""
    count = high - low
    texture = _reduced(texture, int(max(texture.shape[1] * count[0], texture.shape[0] * count[1])))
    height, width = texture.shape[:2]
    rows = ((int(high[1]) - 1) * height, -int(low[1]) * height)
    columns = (-int(low[0]) * width, (int(high[0]) - 1) * width)
    padded = np.pad(texture, ((0, 0), columns, (0, 0)), mode=PADDING[wrap[0]])  # type: ignore
    return np.pad(padded, (rows, (0, 0), (0, 0)), mode=PADDING[wrap[1]])  # type: ignore


def _atlas(parts: list[MeshPart]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """One texture that holds all (each once, plain colours as one texel), and every part's uv."""
    tiles: dict[bytes, NDArray[np.uint8]] = {}
    keys = []
    for part in parts:
        tile = part.texture if part.texture is not None else _vertex_colors(part)[:1, None]
        keys.append(bytes(str(tile.shape), "ascii") + tile.tobytes())
        tiles.setdefault(keys[-1], tile)
    columns = math.ceil(math.sqrt(len(tiles)))
    rows = math.ceil(len(tiles) / columns)
    largest = max(max(tile.shape[:2]) for tile in tiles.values())
    tiles = {key: _reduced(tile, largest * columns) for key, tile in tiles.items()}
    height = max(tile.shape[0] for tile in tiles.values()) + 2 * GUTTER
    width = max(tile.shape[1] for tile in tiles.values()) + 2 * GUTTER
    atlas = np.zeros((rows * height, columns * width, 3), np.uint8)
    corners = {}
    for number, (key, tile) in enumerate(tiles.items()):
        top, left = number // columns * height, number % columns * width
        below, right = height - GUTTER - tile.shape[0], width - GUTTER - tile.shape[1]
        padded = np.pad(tile, ((GUTTER, below), (GUTTER, right), (0, 0)), mode="edge")
        atlas[top : top + height, left : left + width] = padded
        corners[key] = (top + GUTTER, left + GUTTER)
    coordinates = []
    for part, key in zip(parts, keys, strict=True):
        (top, left), (h, w) = corners[key], tiles[key].shape[:2]
        uv = np.full((len(part.vertices), 2), 0.5) if part.uv is None else part.uv.clip(0, 1)
        x, y = left + uv[:, 0] * w, top + (1 - uv[:, 1]) * h
        coordinates.append(np.stack([x / atlas.shape[1], 1 - y / atlas.shape[0]], -1))
    return atlas, np.concatenate(coordinates).astype(np.float32)


def _reduced(tile: NDArray[np.uint8], total: int) -> NDArray[np.uint8]:
    """The tile averaged down by a whole number, so that `total` pixels become `MAX_ATLAS`."""
    from PIL import Image

    factor = math.ceil(total / MAX_ATLAS)
    return np.asarray(Image.fromarray(tile).reduce(factor), np.uint8) if factor > 1 else tile


def _vertex_colors(part: MeshPart) -> NDArray[np.uint8]:
    if part.colors is not None:
        return part.colors
    assert part.texture is not None and part.uv is not None
    return sampled(part.texture, part.uv.astype(np.float64), part.wrap)
