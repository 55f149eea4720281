"""What hides parts of an object: occluders, shadows, windows and borders; boards behind it.

Never renders and never does what a camera does (`camera_effects`). Batched tensor arithmetic; all
randomness comes from the random source that is handed in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import torch
from kornia.geometry.transform import (
    get_perspective_transform,
    warp_affine,
    warp_perspective,
)
from torch import Tensor
from torch.nn import functional

from ..imaging.layers import blend, over, premultiplied
from .config import CastShadowConfig, ImageBorderConfig, OcclusionConfig, VisibleWindowConfig
from .random_source import RandomSource

BOARD = 8  # squares a side of a calibration board


def scatter(
    layers: Tensor, scale: Tensor, spread: float, rng: RandomSource, rotated: bool = True
) -> Tensor:
    """Layers (B, C, N, N) scaled by `scale` (B,), perhaps rotated, at random places of the crop."""
    batch, size = len(layers), layers.shape[-1]
    angle = rng.uniform(batch, between=(-3.14159, 3.14159)) * rotated
    place = (rng.uniform(batch, 2, between=(-0.5, 0.5)) * spread + 0.5) * size
    cosine, sine = angle.cos() * scale, angle.sin() * scale
    matrix = torch.stack([cosine, -sine, sine, cosine], -1).reshape(batch, 2, 2)
    middle = layers.new_full((2,), size / 2)
    shift = place - (matrix @ middle[:, None])[..., 0]
    affine = torch.cat([matrix, shift[..., None]], -1)
    warped: Tensor = warp_affine(layers, affine, (size, size), align_corners=False)
    return warped


def calibration_boards(count: int, size: int, rng: RandomSource) -> Tensor:
    """Calibration boards at random poses: layers (count, 4, size, size)."""
    dark, light = rng.uniform(2, count, 3, 1, 1)
    squares = rng.uniform(count, 1, BOARD, BOARD) < 0.5
    regular = (rng.arange(BOARD)[:, None] + rng.arange(BOARD)) % 2 == 0
    squares = torch.where(rng.bernoulli(count, 0.4)[:, None, None, None], regular, squares)
    board = torch.where(squares, 0.25 * dark, 0.7 + 0.3 * light)
    sheet = functional.interpolate(board, (size, size), mode="nearest")
    whole = sheet.new_tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]).expand(count, 4, 2)
    # In perspective: foreshortened, rotated, and each corner a little elsewhere.
    scale = rng.uniform(count, 1, 2, between=(0.3, 2.5))
    angle = rng.uniform(count, between=(-3.14159, 3.14159))
    turn = torch.stack([angle.cos(), -angle.sin(), angle.sin(), angle.cos()], -1).view(-1, 2, 2)
    corners = (whole - 0.5) * scale @ turn + rng.uniform(count, 1, 2)
    corners = corners + rng.uniform(count, 4, 2, between=(-0.1, 0.1)) * scale
    matrix = get_perspective_transform(whole * size, corners * size)
    layer = torch.cat([sheet, torch.ones_like(sheet[:, :1])], 1)
    seen: Tensor = warp_perspective(layer, matrix, (size, size), align_corners=False)
    return seen


def cutout_masks(count: int, size: int, rng: RandomSource) -> Tensor:
    """Masks of cut-outs of photos, (count, 1, size, size) 0/1: cards, bars and blobs."""
    line = torch.linspace(-1, 1, size, device=rng.device)
    y, x = torch.meshgrid(line, line, indexing="ij")
    wide, high = rng.uniform(2, count, 1, 1, between=(0.25, 1.0))
    card = (x.abs() < wide) & (y.abs() < high)
    coarse = rng.normal(count, 1, 6, 6)
    blob = functional.interpolate(coarse, (size, size), mode="bicubic", align_corners=False)[:, 0]
    is_blob = rng.bernoulli(count, 0.5)[:, None, None]
    return torch.where(is_blob, blob > 0.1, card).float()[:, None]


def occluder_source(
    objects: Callable[[int], Tensor],
    photos: Callable[[int], Tensor],
    config: OcclusionConfig,
    rng: RandomSource,
) -> Callable[[Tensor], Tensor]:
    """A source of occluders: objects, and cut-outs of photos.

    `objects` draws n new layers (n, 4, N, N), colour times alpha and alpha, and `photos` squares
    (n, 3, N, N). The source takes the indices (n,) of the crops and returns layers (n, 4, N, N).
    """

    def draw(chosen: Tensor) -> Tensor:
        layers = objects(len(chosen))
        if config.photo_probability > 0:  # no number is drawn for nothing
            cut = rng.chosen(len(chosen), config.photo_probability)
            mask = cutout_masks(len(cut), layers.shape[-1], rng)
            layers[cut] = premultiplied(photos(len(cut)), mask)
        return layers

    return draw


def random_counts(
    batch: int, probability: float, largest: int, rng: RandomSource
) -> Iterator[Tensor]:
    """Which crops (n,) get a first layer, a second one, and so on up to the `largest` number.

    With this `probability` a crop gets any; each number from 1 on is equally likely.
    """
    number = rng.integers(batch, start=1, below=largest + 1)
    number = number * rng.bernoulli(batch, probability)
    for layer in range(largest):
        chosen = (number > layer).nonzero()[:, 0]
        if not len(chosen):
            return
        yield chosen


def occlude(
    picture: Tensor,
    occluders: Callable[[Tensor], Tensor],
    config: OcclusionConfig,
    rng: RandomSource,
) -> tuple[Tensor, Tensor]:
    """Put occluders in front: the picture (B, 3, N, N) and their alpha (B, 1, N, N).

    `occluders` draws layers (n, 4, N, N), colour times alpha and alpha, for chosen crops (n,).
    """
    picture, occlusion = picture.clone(), torch.zeros_like(picture[:, :1])
    for chosen in random_counts(len(picture), config.probability, config.max_occluders, rng):
        scale = rng.uniform(len(chosen), between=config.scale)
        placed = scatter(occluders(chosen), scale, 1.0, rng, config.random_rotation)
        alpha = placed[:, 3:]
        picture[chosen] = over(picture[chosen], placed)
        occlusion[chosen] = torch.maximum(occlusion[chosen], alpha)
    return picture, occlusion


def show_window(
    photos: Tensor,
    picture: Tensor,
    occlusion: Tensor,
    config: VisibleWindowConfig,
    rng: RandomSource,
) -> tuple[Tensor, Tensor]:
    """Show the photo outside of a rectangle, in a part of the batch.

    Returns the picture and the occlusion. Paper, "Data Augmentation Details", last sentence.
    """
    batch, size = len(picture), picture.shape[-1]
    chosen = rng.bernoulli(batch, config.probability)
    extent = rng.uniform(2, batch, between=config.size).round()
    start = (rng.uniform(2, batch) * (size - extent + 1)).floor()
    line = rng.arange(size)
    inside = (line >= start[..., None]) & (line < (start + extent)[..., None])  # (2, B, N)
    window = (inside[0, :, :, None] & inside[1, :, None, :])[:, None]
    hidden = (chosen[:, None, None, None] & ~window).float()
    return blend(picture, photos, hidden), torch.maximum(occlusion, hidden)


def cast_shadow(picture: Tensor, config: CastShadowConfig, rng: RandomSource) -> Tensor:
    """The soft, straight edge of a shadow across a part of the batch."""
    batch, size = len(picture), picture.shape[-1]
    line = torch.linspace(-1, 1, size, device=rng.device)
    y, x = torch.meshgrid(line, line, indexing="ij")
    angle = rng.uniform(batch, between=(-3.14159, 3.14159))[:, None, None]
    place = rng.uniform(batch, between=(-0.6, 0.6))[:, None, None]
    width = rng.uniform(batch, between=(0.02, 0.3))[:, None, None]
    share = torch.sigmoid((x * angle.cos() + y * angle.sin() - place) / width)
    depth = 1 - rng.uniform(batch, between=config.brightness)
    depth = depth * rng.bernoulli(batch, config.probability)
    return picture * (1 - share * depth[:, None, None])[:, None]


def cut_border(
    picture: Tensor, config: ImageBorderConfig, rng: RandomSource
) -> tuple[Tensor, Tensor]:
    """Black sides where crops reach beyond the image: the picture and the border's mask."""
    batch, size = len(picture), picture.shape[-1]
    width = (
        rng.uniform(batch, between=(0.05, 0.45)) * size * rng.bernoulli(batch, config.probability)
    )
    line = rng.arange(size)
    outside = (line[None] < width[:, None]).float()
    flip = rng.bernoulli(batch, 0.5)[:, None]
    outside = torch.where(flip, outside.flip(-1), outside)
    vertical = rng.bernoulli(batch, 0.5)[:, None, None, None]
    border = torch.where(vertical, outside[:, None, :, None], outside[:, None, None, :])
    border = border.expand(batch, 1, size, size)
    return picture * (1 - border), border
