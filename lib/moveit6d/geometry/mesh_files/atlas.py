"""Pictures, plain colours and charts of several parts in one texture.

Never reads files, and never decides what a part looks like.
"""

from __future__ import annotations

import hashlib
import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .charts import chart_shape, charted, patch_side, varies
from .content import MeshPart

MAX_ATLAS = 4096  # texels a side, without gutters and plain colours
GUTTER = 8  # texels around each tile, so that tiles do not bleed into each other
# Side of a plain colour: a power of two, at multiples of it, so that halvings keep it pure.
CELL = 2 * GUTTER
FINE_PATCH = 5  # side of a patch; smaller ones show what lies between three corners less exactly
LEAST_SIDE = 16  # pictures are not reduced further than this to make room
WIDTHS = 16  # of an atlas that are tried at most
STEP = 0.9  # from one size of pictures that is tried to the next

Shape = tuple[int, int]  # height and width, texels


@dataclass(frozen=True)
class Atlas:
    """A texture (H, W, 3) and the parts with their places in it; `warning` says what it cost."""

    texture: NDArray[np.uint8]
    parts: list[MeshPart]
    warning: str = ""


@dataclass(frozen=True)
class Layout:
    """Where the tiles lie: the top left corner of each, plain colours in `rows` above all."""

    shape: Shape
    corners: list[tuple[int, int]]
    rows: int  # of plain colours


def packed(parts: list[MeshPart]) -> Atlas | None:
    """One texture for all parts, or None if there is no room for a patch for each face.

    Textures have coordinates in [0, 1]. A part without a texture has one colour, or gets a chart of
    its colours. Where there is no room for all, the largest pictures are reduced.
    """
    parts = shared(parts)
    colors = {_color(part): k for k, part in enumerate(parts) if _is_plain(part)}
    tiles = {_key(part): part for part in parts if not _is_plain(part)}
    found = _roomy(list(tiles.values()), len(colors))
    if found is None:
        return None
    side, patch, layout = found
    fitted = {key: _fitted(part, side, patch) for key, part in tiles.items()}
    corners = dict(zip(tiles, layout.corners, strict=True))
    texture = _drawn(layout, list(colors), [part.texture for part in fitted.values()])
    cells = {color: k for k, color in enumerate(colors)}
    placed = []
    for part in parts:
        if _is_plain(part):
            row, column = divmod(cells[_color(part)], layout.shape[1] // CELL)
            middle = ((row + 0.5) * CELL, (column + 0.5) * CELL)
            placed.append(_at(part, layout.shape, middle, (0, 0)))
        else:
            tile = fitted[_key(part)]
            assert tile.texture is not None
            shown = tile if varies(part) else part
            placed.append(_at(shown, layout.shape, corners[_key(part)], tile.texture.shape[:2]))
    return Atlas(texture, placed, _cost(list(tiles.values()), side))


def shared(parts: list[MeshPart]) -> list[MeshPart]:
    """The parts with one array for all pictures that are equal."""
    one: dict[int, NDArray[np.uint8]] = {}
    known: dict[tuple[tuple[int, ...], bytes], NDArray[np.uint8]] = {}
    for part in parts:
        if part.texture is not None and id(part.texture) not in one:
            digest = hashlib.sha256(part.texture.tobytes()).digest()
            one[id(part.texture)] = known.setdefault((part.texture.shape, digest), part.texture)
    return [
        part if part.texture is None else replace(part, texture=one[id(part.texture)])
        for part in parts
    ]


def reduced(picture: NDArray[np.uint8], side: float) -> NDArray[np.uint8]:
    """The picture averaged down to at most `side` pixels a side."""
    from PIL import Image

    height, width = _reduced_shape(picture, side)
    if (height, width) == picture.shape[:2]:
        return picture
    image = Image.fromarray(picture).resize((width, height), Image.Resampling.BOX)
    return np.asarray(image, np.uint8)


def _reduced_shape(picture: NDArray[np.uint8], side: float) -> Shape:
    height, width = picture.shape[:2]
    scale = min(1.0, side / max(height, width))
    return max(1, round(height * scale)), max(1, round(width * scale))


def _is_plain(part: MeshPart) -> bool:
    return part.texture is None and not varies(part)


def _color(part: MeshPart) -> tuple[int, ...]:
    assert part.colors is not None
    return tuple(part.colors[0].tolist())


def _key(part: MeshPart) -> int:
    """The same for parts that show the same picture."""
    return id(part) if varies(part) else id(part.texture)


def _fitted(part: MeshPart, side: int, patch: int) -> MeshPart:
    if varies(part):
        return charted(part, patch_side(part, side, patch))
    assert part.texture is not None
    return replace(part, texture=reduced(part.texture, side))


def _fitted_shape(part: MeshPart, side: int, patch: int) -> Shape:
    if varies(part):
        return chart_shape(len(part.faces), patch_side(part, side, patch))
    assert part.texture is not None
    return _reduced_shape(part.texture, side)


def _roomy(tiles: list[MeshPart], colors: int) -> tuple[int, int, Layout] | None:
    """How large pictures and charts, and how large patches at least may be so that all have room.

    First with fine patches, unless pictures shrink to less than half for that.
    """
    if any(varies(part) and not patch_side(part) for part in tiles):
        return None
    pictures = _picture_sides(tiles)
    start = max((max(_fitted_shape(part, MAX_ATLAS, 0)) for part in tiles), default=LEAST_SIDE)
    for patch, end in ((FINE_PATCH, max(pictures, default=0) // 2), (0, LEAST_SIDE)):
        side = max(start, LEAST_SIDE)
        while side >= max(end, LEAST_SIDE):
            layout = _layout([_fitted_shape(part, side, patch) for part in tiles], colors)
            if layout is not None:
                return side, patch, layout
            side = int(side * STEP)
    return None


def _picture_sides(tiles: list[MeshPart]) -> list[int]:
    return [max(t.texture.shape[:2]) for t in tiles if t.texture is not None and not varies(t)]


def _layout(shapes: list[Shape], colors: int) -> Layout | None:
    """The smallest atlas of several widths; None if none is small enough."""
    # As many gutters as a square of tiles has, so that four pictures of 2048 need no reduction.
    limit = MAX_ATLAS + 2 * GUTTER * (math.ceil(math.sqrt(len(shapes))) + 1)
    tallest = limit + CELL * math.ceil(colors / (limit // CELL))
    sizes = [(height + 2 * GUTTER, width + 2 * GUTTER) for height, width in shapes]
    order = sorted(range(len(sizes)), key=lambda k: sizes[k], reverse=True)
    widest = max((width for _, width in sizes), default=CELL)
    lengths = np.cumsum([sizes[k][1] for k in order])
    lengths = lengths[lengths <= limit]
    tried = {*lengths[:: 1 + len(lengths) // WIDTHS].tolist(), limit}
    tried.add(CELL * math.ceil(math.sqrt(colors)))
    best = None
    for width in sorted(one for one in tried if widest <= one <= limit):
        across = math.ceil(width / CELL)
        rows = math.ceil(colors / across)
        corners, height = _shelves(sizes, order, width, rows * CELL)
        shape = (math.ceil(height / CELL) * CELL, across * CELL)
        small = best is None or shape[0] * shape[1] < best.shape[0] * best.shape[1]
        if height <= tallest and small:
            best = Layout(shape, corners, rows)
    return best


def _shelves(
    sizes: list[Shape], order: list[int], width: int, top: int
) -> tuple[list[tuple[int, int]], int]:
    """Corners of tiles inside of their gutters, and the height: highest first, row by row.

    Each goes into the first row that has room for it; rows begin at `top`.
    """
    corners = [(0, 0)] * len(sizes)
    shelves: list[list[int]] = []  # top and what is used of the width, of those with room left
    narrowest = min((one for _, one in sizes), default=0)
    for k in order:
        shelf = next((one for one in shelves if one[1] + sizes[k][1] <= width), None)
        if shelf is None:
            shelf = [top, 0]
            shelves.append(shelf)
            top += sizes[k][0]
        corners[k] = (shelf[0] + GUTTER, shelf[1] + GUTTER)
        shelf[1] += sizes[k][1]
        if shelf[1] + narrowest > width:
            shelves.remove(shelf)
    return corners, top


def _drawn(
    layout: Layout, colors: list[tuple[int, ...]], tiles: list[NDArray[np.uint8] | None]
) -> NDArray[np.uint8]:
    pictures = [tile for tile in tiles if tile is not None]
    texture = np.empty((*layout.shape, 3), np.uint8)
    # What nothing shows adds no colour, or an object of one flat colour would not be noticed.
    texture[:] = colors[0] if colors else pictures[0][0, 0]
    if colors:
        across = layout.shape[1] // CELL
        table = np.full((layout.rows * across, 3), colors[0], np.uint8)
        table[: len(colors)] = colors
        blocks = table.reshape(layout.rows, across, 3).repeat(CELL, 0).repeat(CELL, 1)
        texture[: layout.rows * CELL] = blocks
    for (top, left), picture in zip(layout.corners, pictures, strict=True):
        around = np.pad(picture, ((GUTTER, GUTTER), (GUTTER, GUTTER), (0, 0)), mode="edge")
        height, width = around.shape[:2]
        texture[top - GUTTER :, left - GUTTER :][:height, :width] = around
    return texture


def _at(
    part: MeshPart, atlas: Shape, corner: tuple[float, float], shape: tuple[int, ...]
) -> MeshPart:
    """The part with texture coordinates in the atlas, its own tile at a corner (top, left)."""
    uv = np.zeros((len(part.vertices), 2)) if part.uv is None else part.uv.clip(0, 1)
    x, y = corner[1] + uv[:, 0] * shape[1], corner[0] + (1 - uv[:, 1]) * shape[0]
    places = np.stack([x / atlas[1], 1 - y / atlas[0]], -1)
    return MeshPart(part.vertices, part.faces, places.astype(np.float32))


def _cost(tiles: list[MeshPart], side: int) -> str:
    """What to warn of where pictures had to be reduced."""
    sides = _picture_sides(tiles)
    smaller = [one for one in sides if one > side]
    if not smaller:
        return ""
    return (
        f"{len(smaller)} of its {len(sides)} pictures are reduced, the largest from "
        f"{max(smaller)} to {side} pixels a side, to have room in one texture; "
        "fewer or smaller pictures would be kept as they are"
    )
