"""What stands between an object and a picture of it: occluders, shadows, cut-off parts and borders.

Never renders; what the camera itself does is in `lens_effects`. Batched tensor arithmetic; all
randomness comes from the generator that is handed in.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from kornia.geometry.transform import (
    get_perspective_transform,
    warp_affine,
    warp_perspective,
)
from torch import Tensor
from torch.nn import functional

Range = tuple[float, float]
BOARD = 8  # squares a side of a board of marks


@dataclass(frozen=True)
class AugmentConfig:
    """Shares and ranges of what disturbs the observed patch; sizes in pixels of the patch of 128.

    The defaults are what the shipped model was trained with; the paper's numbers, each with its
    place in the paper, stand in configs/pairs/paper.yaml.
    """

    # Blur and colour of the whole picture, as a camera makes them, or of the object and of each
    # occluder before they are put in front of the photo, as in the paper.
    acts_on: Literal["picture", "objects"] = "picture"
    gamma: Range = (1.0, 1.0)  # colour = light ** (1 / gamma); 1: edges and blurs mix colours
    occluded: float = 0.55  # share of patches with anything in front of the object
    occluders: int = 3  # at most; each number is as likely
    occluder_scale: Range = (0.2, 1.1)  # of the patch
    occluder_turned: bool = True  # whether occluders are turned in the picture
    photo_occluder: float = 0.45  # share of occluders cut from photos instead of other objects
    cropped: float = 0.0  # share of which only a rectangle shows, the photo around it
    crop: Range = (72.0, 96.0)  # height and width of that rectangle
    boards: float = 0.0  # share of photos in which a board of dark and light squares lies
    cluttered: float = 0.4  # share with other objects behind
    clutter: int = 1  # at most; each number is as likely
    same_colour_distractors: float = 0.3  # share of those: the same object again
    background_blurred: float = 0.0  # share of photos that lie out of focus
    background_blur: Range = (0.5, 3.5)  # standard deviation
    shadowed: float = 0.3  # share with the edge of a shadow across the picture
    shadow: Range = (0.35, 0.8)  # what brightness a shadow leaves
    blurred: float = 0.4
    defocus: Range = (0.2, 1.4)  # standard deviation
    motion_blurred: float = 0.4  # share of the blurred ones that moved as well
    motion: Range = (0.0, 16.0)  # length of the smear …
    motion_sigma: float = 0.0  # … or, above 0, |N(0, σ)| patch widths
    radial: float = 0.0  # share with a radial (zoom) blur
    radial_sigma: float = 0.05  # of its zoom
    lens_error: float = 0.0  # share seen through a lens that the camera file gets wrong
    lens_error_pixels: Range = (0.3, 1.5)  # how far off it is at the worst place of the patch
    sharpened: float = 0.15  # share that a camera has sharpened
    sharpness: Range = (0.3, 1.5)  # how much of the lost detail is added again
    downsampled: float = 0.4  # share seen at a lower resolution
    resolution: Range = (0.3, 0.95)  # of the patch's own; at 0.3 an object is 27 pixels wide
    jpeg: float = 0.35
    jpeg_quality: Range = (35.0, 92.0)
    brightness: Range = (0.7, 1.3)
    contrast: Range = (0.75, 1.3)
    saturation: Range = (0.5, 1.35)
    channel_gain: float = 0.1
    noise: Range = (0.0, 0.025)
    border: float = 0.1  # share that reaches beyond the image: a black side


class RandomSource:
    """Random numbers of one generator in the forms that augmentation needs."""

    def __init__(self, generator: torch.Generator) -> None:
        self.generator, self.device = generator, generator.device
        self.host = np.random.default_rng(generator.initial_seed())

    def uniform(self, *shape: int, between: Range = (0.0, 1.0)) -> Tensor:
        """Uniform numbers of the given shape."""
        values = torch.rand(*shape, generator=self.generator, device=self.device)
        return values * (between[1] - between[0]) + between[0]

    def normal(self, *shape: int) -> Tensor:
        """Normal numbers of the given shape."""
        return torch.randn(*shape, generator=self.generator, device=self.device)

    def chance(self, count: int, share: float) -> Tensor:
        """Which of `count` it happens to: bool (count,)."""
        return self.uniform(count) < share

    def one(self, between: Range = (0.0, 1.0)) -> float:
        """A number at once: no device is waited for."""
        return float(self.host.uniform(*between))

    def whole(self, *shape: int, below: int, start: int = 0) -> Tensor:
        """Whole numbers from `start` to `below` − 1 of the given shape."""
        return torch.randint(start, below, shape, generator=self.generator, device=self.device)

    def line(self, count: int) -> Tensor:
        """0, 1, … `count` − 1 as floats."""
        return torch.arange(count, device=self.device, dtype=torch.float32)

    def permutation(self, count: int) -> Tensor:
        """A random order of `count` things."""
        return torch.randperm(count, generator=self.generator, device=self.device)


def over(picture: Tensor, layer: Tensor) -> Tensor:
    """A layer (B, 4, H, W) of colour × alpha and alpha over a picture (B, 3, H, W)."""
    return picture * (1 - layer[:, 3:]) + layer[:, :3]


def paste(picture: Tensor, layer: Tensor, alpha: Tensor) -> Tensor:
    """Layer over picture: (B, 3, H, W) each, alpha (B, 1, H, W) in [0, 1]."""
    return picture + (layer - picture) * alpha


def scatter(
    layers: Tensor, scale: Tensor, spread: float, rng: RandomSource, turned: bool = True
) -> Tensor:
    """Layers (B, C, N, N), shrunk by `scale` (B,), perhaps turned, put somewhere in the patch."""
    batch, size = len(layers), layers.shape[-1]
    angle = rng.uniform(batch, between=(-3.14159, 3.14159)) * turned
    place = (rng.uniform(batch, 2, between=(-0.5, 0.5)) * spread + 0.5) * size
    cosine, sine = angle.cos() * scale, angle.sin() * scale
    matrix = torch.stack([cosine, -sine, sine, cosine], -1).reshape(batch, 2, 2)
    middle = layers.new_full((2,), size / 2)
    shift = place - (matrix @ middle[:, None])[..., 0]
    affine = torch.cat([matrix, shift[..., None]], -1)
    warped: Tensor = warp_affine(layers, affine, (size, size), align_corners=False)
    return warped


def calibration_boards(count: int, size: int, rng: RandomSource) -> Tensor:
    """Calibration boards, markers and the like as they lie about: layers (count, 4, size, size)."""
    dark, light = rng.uniform(2, count, 3, 1, 1)
    squares = rng.uniform(count, 1, BOARD, BOARD) < 0.5
    regular = (rng.line(BOARD)[:, None] + rng.line(BOARD)) % 2 == 0
    squares = torch.where(rng.chance(count, 0.4)[:, None, None, None], regular, squares)
    print_ = torch.where(squares, 0.25 * dark, 0.7 + 0.3 * light)
    sheet = functional.interpolate(print_, (size, size), mode="nearest")
    whole = sheet.new_tensor([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]).expand(count, 4, 2)
    # Seen at a slant: foreshortened, turned, and each corner a little elsewhere.
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
    """Shapes of things cut from photos, (count, 1, size, size) 0/1: cards, bars and blobs."""
    line = torch.linspace(-1, 1, size, device=rng.device)
    y, x = torch.meshgrid(line, line, indexing="ij")
    wide, high = rng.uniform(2, count, 1, 1, between=(0.25, 1.0))
    card = (x.abs() < wide) & (y.abs() < high)
    coarse = rng.normal(count, 1, 6, 6)
    blob = functional.interpolate(coarse, (size, size), mode="bicubic", align_corners=False)[:, 0]
    is_blob = rng.chance(count, 0.5)[:, None, None]
    return torch.where(is_blob, blob > 0.1, card).float()[:, None]


def loose_things(
    objects: Tensor, photos: Tensor, config: AugmentConfig, rng: RandomSource
) -> Callable[[Tensor], Tensor]:
    """A source of occluders: other objects of the batch, and shapes cut from photos.

    `objects` (B, 4, N, N) are lit objects (0 outside) with their mask, `photos` (B, 3, N, N). The
    source is asked with the indices (n,) of the patches and answers with layers (n, 4, N, N).
    """

    def draw(chosen: Tensor) -> Tensor:
        count = len(chosen)
        things = objects[rng.permutation(len(objects))[:count]]
        cut = rng.chance(count, config.photo_occluder).nonzero()[:, 0]
        shape = cutout_masks(len(cut), objects.shape[-1], rng)
        prints = photos[rng.permutation(len(photos))[: len(cut)]]
        things[cut] = torch.cat([prints * shape, shape], 1)
        return things

    return draw


def rounds(batch: int, share: float, most: int, rng: RandomSource) -> Iterator[Tensor]:
    """Which patches (n,) get a first thing, a second one, and so on to `most`.

    A `share` of the patches get any; of those each number of things is as likely.
    """
    number = rng.whole(batch, start=1, below=most + 1)
    number = number * rng.chance(batch, share)
    for layer in range(most):
        chosen = (number > layer).nonzero()[:, 0]
        if not len(chosen):
            return
        yield chosen


def occlude(
    picture: Tensor, things: Callable[[Tensor], Tensor], config: AugmentConfig, rng: RandomSource
) -> tuple[Tensor, Tensor]:
    """Put occluders in front: the picture (B, 3, N, N) and their alpha (B, 1, N, N).

    `things` draws layers (n, 4, N, N), colour times alpha and alpha, for the chosen patches (n,).
    """
    picture, occlusion = picture.clone(), torch.zeros_like(picture[:, :1])
    for chosen in rounds(len(picture), config.occluded, config.occluders, rng):
        scale = rng.uniform(len(chosen), between=config.occluder_scale)
        placed = scatter(things(chosen), scale, 1.0, rng, config.occluder_turned)
        alpha = placed[:, 3:]
        picture[chosen] = over(picture[chosen], placed)
        occlusion[chosen] = torch.maximum(occlusion[chosen], alpha)
    return picture, occlusion


def loose(layer: Tensor) -> tuple[Tensor, Tensor]:
    """Colour (B, 3, H, W) and alpha (B, 1, H, W) of a layer (B, 4, H, W) of colour × alpha."""
    alpha = layer[:, 3:]
    return layer[:, :3] / alpha.clamp_min(1e-3), alpha


def crop_region(
    photos: Tensor, picture: Tensor, occlusion: Tensor, config: AugmentConfig, rng: RandomSource
) -> tuple[Tensor, Tensor]:
    """Let only a rectangle of everything before the photo show, in a part of the batch.

    Returns the picture and the occlusion. Paper, "Data Augmentation Details", last sentence.
    """
    batch, size = len(picture), picture.shape[-1]
    chosen = rng.chance(batch, config.cropped)
    extent = rng.uniform(2, batch, between=config.crop).round()
    start = (rng.uniform(2, batch) * (size - extent + 1)).floor()
    line = rng.line(size)
    inside = (line >= start[..., None]) & (line < (start + extent)[..., None])  # (2, B, N)
    window = (inside[0, :, :, None] & inside[1, :, None, :])[:, None]
    hidden = (chosen[:, None, None, None] & ~window).float()
    return paste(picture, photos, hidden), torch.maximum(occlusion, hidden)


def shadow(picture: Tensor, config: AugmentConfig, rng: RandomSource) -> Tensor:
    """The edge of a shadow, soft and straight, across a part of the batch."""
    batch, size = len(picture), picture.shape[-1]
    line = torch.linspace(-1, 1, size, device=rng.device)
    y, x = torch.meshgrid(line, line, indexing="ij")
    angle = rng.uniform(batch, between=(-3.14159, 3.14159))[:, None, None]
    place = rng.uniform(batch, between=(-0.6, 0.6))[:, None, None]
    width = rng.uniform(batch, between=(0.02, 0.3))[:, None, None]
    share = torch.sigmoid((x * angle.cos() + y * angle.sin() - place) / width)
    depth = 1 - rng.uniform(batch, between=config.shadow)
    depth = depth * rng.chance(batch, config.shadowed)
    return picture * (1 - share * depth[:, None, None])[:, None]


def cut_border(picture: Tensor, config: AugmentConfig, rng: RandomSource) -> tuple[Tensor, Tensor]:
    """Black sides where the patch reaches beyond the image: the picture and the border mask."""
    batch, size = len(picture), picture.shape[-1]
    width = rng.uniform(batch, between=(0.05, 0.45)) * size * rng.chance(batch, config.border)
    line = rng.line(size)
    outside = (line[None] < width[:, None]).float()
    flip = rng.chance(batch, 0.5)[:, None]
    outside = torch.where(flip, outside.flip(-1), outside)
    vertical = rng.chance(batch, 0.5)[:, None, None, None]
    border = torch.where(vertical, outside[:, None, :, None], outside[:, None, None, :])
    border = border.expand(batch, 1, size, size)
    return picture * (1 - border), border
