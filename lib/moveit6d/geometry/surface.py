"""Mesh files as plain arrays: positions, triangles, and a texture or a colour per vertex.

Never changes units or frames and never computes normals; `Mesh` does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError

SUFFIXES = (".obj", ".ply", ".glb", ".gltf", ".stl", ".off")
PLAIN = (160, 160, 160)  # a surface without any colour of its own
MAX_TEXTURE = 2048  # pixels a side; a patch of 128 pixels never sees more
# White changes nothing, and trimesh writes its default grey beside textures that mean no factor.
NO_FACTOR = ((255, 255, 255), (102, 102, 102))
MAX_ATLAS = 4096
GUTTER = 8  # pixels around each tile of an atlas, so that tiles do not bleed into each other


@dataclass
class Surface:
    """Triangles with colour. Exactly one of `texture` (with `uv`, v up) and `colors` is set."""

    vertices: NDArray[np.float64]  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3)
    uv: NDArray[np.float32] | None = None  # (V, 2)
    texture: NDArray[np.uint8] | None = None  # (H, W, 3)
    colors: NDArray[np.uint8] | None = None  # (V, 3)


def read_surface(path: Path) -> Surface:
    """Every triangle of a mesh file in the file's frame and unit, several parts joined to one."""
    import trimesh

    if not path.is_file():
        raise InputError(f"{path}: there is no such mesh file.")
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path}: a mesh must be one of {', '.join(SUFFIXES)}.")
    try:
        parts = trimesh.load_scene(path, process=False).dump()
    except Exception as error:  # trimesh raises whatever its format readers stumble upon
        raise InputError(f"{path}: cannot be read as a mesh ({error}).") from error
    meshes = [part for part in parts if len(getattr(part, "faces", ())) > 0]
    if not meshes:
        raise InputError(f"{path}: holds no faces; a mesh of triangles is needed.")
    return join([_part(mesh) for mesh in meshes])


def join(parts: list[Surface]) -> Surface:
    """Several surfaces as one, their textures packed into one atlas.

    Where an atlas cannot hold them (repeating textures, or textures beside colours that vary from
    vertex to vertex) each vertex takes the colour of its texture instead.
    """
    if len(parts) == 1:
        return parts[0]
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    joined = Surface(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
    )
    textures = {None if part.texture is None else part.texture.tobytes() for part in parts}
    if len(textures) == 1 and None not in textures:
        joined.texture = parts[0].texture
        joined.uv = np.concatenate([part.uv for part in parts if part.uv is not None])
    elif textures != {None} and all(_packable(part) for part in parts):
        joined.texture, joined.uv = _atlas(parts)
    else:
        joined.colors = np.concatenate([_vertex_colors(part) for part in parts])
    return joined


def _part(mesh: Any) -> Surface:
    visual, vertices, faces = mesh.visual, np.array(mesh.vertices), np.array(mesh.faces)
    if visual.kind == "texture":
        material, uv = visual.material, visual.uv
        image = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        if image is not None and uv is not None and len(uv) == len(vertices):
            texture = _pixels(image, getattr(material, "baseColorFactor", None))
            return Surface(vertices, faces, np.asarray(uv, np.float32), texture)
        color = _material_color(material)
        return Surface(vertices, faces, colors=np.tile(color, (len(vertices), 1)))
    if visual.kind == "face":
        colors = np.repeat(np.asarray(visual.face_colors)[:, :3].astype(np.uint8), 3, axis=0)
        corners = np.arange(3 * len(faces)).reshape(-1, 3)
        return Surface(vertices[faces.reshape(-1)], corners, colors=colors)
    if visual.kind == "vertex":
        colors = np.asarray(visual.vertex_colors)[:, :3].astype(np.uint8)
        return Surface(vertices, faces, colors=colors)
    return Surface(vertices, faces, colors=np.full((len(vertices), 3), PLAIN, np.uint8))


def _material_color(material: Any) -> NDArray[np.uint8]:
    factor = getattr(material, "baseColorFactor", None)
    if factor is not None:
        return np.asarray(np.rint(255 * _factor(factor)), np.uint8)
    if hasattr(material, "baseColorFactor"):  # glTF without a factor is white
        return np.full(3, 255, np.uint8)
    return np.asarray(material.main_color)[:3].astype(np.uint8)


def _factor(factor: Any) -> NDArray[np.float64]:
    """glTF's colour factors are linear light; pictures are not, hence the exponent."""
    values = np.asarray(factor)[:3]
    scale = 255.0 if values.dtype.kind in "ui" else 1.0
    return np.asarray((values / scale).clip(0, 1) ** (1 / 2.2), np.float64)


def _pixels(image: Any, factor: Any) -> NDArray[np.uint8]:
    """A PIL image as RGB (H, W, 3), at most `MAX_TEXTURE` on a side, times the colour factor."""
    from PIL import Image

    if image.mode.startswith("I"):  # 16 bits: PIL would clip instead of scale
        image = image.point(lambda value: value / 256)
    image = image.convert("RGB")
    scale = MAX_TEXTURE / max(image.size)
    if scale < 1:
        smaller = [max(1, round(side * scale)) for side in image.size]
        image = image.resize(smaller, Image.Resampling.BOX)
    pixels = np.asarray(image, np.uint8)
    if factor is not None and tuple(np.asarray(factor)[:3]) not in NO_FACTOR:
        pixels = np.rint(pixels * _factor(factor)).astype(np.uint8)
    return np.ascontiguousarray(pixels)


def _packable(part: Surface) -> bool:
    if part.uv is not None:
        return bool(part.uv.min() >= -1e-3 and part.uv.max() <= 1 + 1e-3)
    return part.colors is not None and bool((part.colors == part.colors[:1]).all())


def _atlas(parts: list[Surface]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
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


def _vertex_colors(part: Surface) -> NDArray[np.uint8]:
    if part.colors is not None:
        return part.colors
    assert part.texture is not None and part.uv is not None
    height, width = part.texture.shape[:2]
    x = ((part.uv[:, 0] % 1) * width).astype(np.int64).clip(0, width - 1)
    y = ((1 - part.uv[:, 1] % 1) * height).astype(np.int64).clip(0, height - 1)
    return np.asarray(part.texture[y, x])
