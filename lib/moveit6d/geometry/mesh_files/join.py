"""Several parts with different looks as one surface with one texture or a colour per vertex.

Never reads files and never changes the shape.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from .atlas import MAX_ATLAS, packed, reduced, shared
from .charts import charted, patch_side, per_vertex, varies
from .content import MeshPart
from .pictures import tinted, to_linear

PLAIN = (160, 160, 160)  # a surface without any colour of its own
MAX_REPEATS = 1024  # of a texture within one face; more are finer than any pixel
PADDING = {"repeat": "wrap", "mirror": "symmetric", "clamp": "edge"}


@dataclass
class Surface:
    """Triangles with colour. Exactly one of `texture` (with `uv`, v up) and `colors` is set.

    `warnings` says what the parts lost of their looks to become one.
    """

    vertices: NDArray[np.float64]  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3)
    uv: NDArray[np.float32] | None = None  # (V, 2)
    texture: NDArray[np.uint8] | None = None  # (H, W, 3)
    colors: NDArray[np.uint8] | None = None  # (V, 3)
    warnings: list[str] = field(default_factory=list)


def join(parts: list[MeshPart]) -> Surface:
    """All parts as one surface, their textures packed into one atlas.

    A texture that repeats is laid out as often as its faces need. A part whose colours vary from
    vertex to vertex gets a patch of the atlas for each face if there are textures.
    """
    parts = shared([_single(part) for part in parts])
    if all(part.texture is None for part in parts):
        return _colored(parts)
    alike = len({id(part.texture) for part in parts}) == 1
    wraps = all(part.wrap == ("repeat", "repeat") for part in parts)
    if alike and wraps and not any(map(varies, parts)):
        return _textured(parts, parts[0].texture)
    warnings: list[str] = []
    parts = [_flat(part, warnings) for part in parts]
    if len(parts) == 1 and parts[0].texture is not None and not varies(parts[0]):
        surface = _textured(parts, parts[0].texture)
    elif len(parts) == 1 and varies(parts[0]) and patch_side(parts[0]):
        chart = charted(parts[0], patch_side(parts[0]))
        surface = _textured([chart], chart.texture)
    else:
        surface = _in_atlas(parts, warnings)
    surface.warnings = warnings
    return surface


def _in_atlas(parts: list[MeshPart], warnings: list[str]) -> Surface:
    atlas = packed(parts)
    if atlas is None:
        warnings.append(
            "its faces whose colours vary from vertex to vertex are too many for a texture; all "
            "pictures are shown by the colours at the vertices alone"
        )
        return _colored(parts)
    if atlas.warning:
        warnings.append(atlas.warning)
    return _textured(atlas.parts, atlas.texture)


def _single(part: MeshPart) -> MeshPart:
    """The part with colours, with a texture, or with both if its colours vary."""
    if part.texture is None or part.uv is None:
        colors = part.colors
        if colors is None:
            color = PLAIN if part.color is None else part.color
            colors = np.tile(np.asarray(color, np.uint8), (len(part.vertices), 1))
        return MeshPart(part.vertices, part.faces, colors=colors)
    if part.colors is None or varies(part):
        return part
    texture = tinted(part.texture, to_linear(part.colors[0]))
    return MeshPart(part.vertices, part.faces, part.uv, texture, wrap=part.wrap)


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
    surface.colors = np.concatenate([per_vertex(part) for part in parts])
    return surface


def _flat(part: MeshPart, warnings: list[str]) -> MeshPart:
    """The part with texture coordinates in [0, 1]: what repeats is laid out in its texture.

    Charts are drawn from repeating textures as they are.
    """
    if part.texture is None or part.uv is None or varies(part):
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
    texture = _laid_out(part.texture, low, high, part.wrap, warnings)
    key = np.concatenate(
        [part.faces.reshape(-1, 1), np.repeat(shift, 3, axis=0)], 1
    )  # corners of a vertex that are moved alike stay one vertex
    _, first, faces = np.unique(key, axis=0, return_index=True, return_inverse=True)
    uv = ((moved - low) / (high - low)).reshape(-1, 2)[first].clip(0, 1)
    vertices = part.vertices[part.faces.reshape(-1)[first]]
    return MeshPart(vertices, faces.reshape(-1, 3), uv.astype(np.float32), texture)


def _laid_out(
    texture: NDArray[np.uint8], low: NDArray[np.int64], high: NDArray[np.int64],
    wrap: tuple[str, str], warnings: list[str],
) -> NDArray[np.uint8]:  # fmt: skip
    """The texture continued over the tiles from `low` to `high` (u, v), v up."""
    whole, count = max(texture.shape[:2]), high - low
    total = max(texture.shape[1] * count[0], texture.shape[0] * count[1])
    if total > MAX_ATLAS:
        texture = reduced(texture, whole * MAX_ATLAS / total)
        what = (
            f"a picture that repeats {int(count[0])}×{int(count[1])} times is reduced from {whole} "
            f"to {max(texture.shape[:2])} pixels a side, to have room in one texture"
        )
        warnings += [what] * (what not in warnings)
    height, width = texture.shape[:2]
    rows = ((int(high[1]) - 1) * height, -int(low[1]) * height)
    columns = (-int(low[0]) * width, (int(high[0]) - 1) * width)
    padded = np.pad(texture, ((0, 0), columns, (0, 0)), mode=PADDING[wrap[0]])  # type: ignore
    return np.pad(padded, (rows, (0, 0), (0, 0)), mode=PADDING[wrap[1]])  # type: ignore
