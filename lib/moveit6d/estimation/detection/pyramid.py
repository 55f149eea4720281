"""An image at many scales, and patches of it, as descriptors: what templates are compared with.

Never knows an object.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import torch
from torch import Tensor
from torch.nn import functional

from ...config import TemplateConfig
from ...frame import Frame
from ...geometry.crop import View, crop_patch, look_at, patch_to_image
from ...policies import BATCH_SIZE
from ..seeding import seed_poses
from .templates import CELL, Describe, colour_cells

Window = tuple[int, int, int, int]  # left, top, right, bottom in image pixels
MEAN_SIDE = 240  # shorter side at which the mean of an image's descriptors is measured, pixels


@dataclass(frozen=True)
class Level:
    """An image at the scale at which an object of one width is as wide as the coarse templates.

    `width` is the sphere's in pixels of the image, `scale` the level's pixels an image pixel,
    `left` and `top` the image pixel of the level's corner; `features` (D, h, w) are normalised
    descriptors without the image's mean, `colours` (3, h, w) as `colour_cells` has them.
    """

    width: float
    scale: float
    left: float
    top: float
    features: Tensor
    colours: Tensor

    def pixel(self, x: float, y: float) -> tuple[float, float]:
        """Image pixel of a place in cells (half-pixel rule)."""
        return (
            (x + 0.5) * CELL / self.scale - 0.5 + self.left,
            (y + 0.5) * CELL / self.scale - 0.5 + self.top,
        )


@dataclass(frozen=True)
class Patches:
    """Look-at patches of an image in which an object of some width is as wide as the templates.

    `features` (N, D, k, k) as in a `Level`; `back` (N, 3, 3) takes pixels of the patches to the
    image's.
    """

    features: Tensor
    back: Tensor

    def pixel(self, patch: int, right: int, down: int) -> tuple[float, float]:
        """Image pixel so many cells to the right of the middle of a patch and below it."""
        middle = (self.features.shape[-1] * CELL - 1) / 2
        place = [middle + CELL * right, middle + CELL * down, 1.0]
        x, y, z = (self.back[patch] @ self.back.new_tensor(place)).tolist()
        return x / z, y / z


def ladder(low: float, high: float, step: float) -> list[float]:
    """Widths from `low` to `high` with at most the ratio `step` between neighbours."""
    count = max(1, math.ceil(math.log(max(high / low, 1.0)) / math.log(step) - 1e-6) + 1)
    if count == 1:
        return [math.sqrt(low * high)]
    return [low * (high / low) ** (k / (count - 1)) for k in range(count)]


class Pyramid:
    """The descriptors of one frame without a lens, each made once for all objects in it."""

    def __init__(self, frame: Frame, describe: Describe, config: TemplateConfig) -> None:
        pixels = frame.pixels
        self.image = pixels if pixels.is_floating_point() else pixels.to(torch.float32) / 255
        self.frame, self.describe, self.config = frame, describe, config
        self._levels: dict[tuple[float, Window | None], Level] = {}
        self._background: dict[tuple[int, int, float, float], Patches] = {}

    @cached_property
    def mean(self) -> Tensor:
        """Mean descriptor (D,) of the image.

        A mean around each cell instead would be that of the object and what lies beside it.
        """
        scale = MEAN_SIDE / min(self.image.shape[1:])
        return self.describe(_resized(self.image, scale))[0].mean((1, 2))

    @torch.inference_mode()
    def level(self, width: float, window: Window | None = None) -> Level:
        """The level for objects of a width; of the part of the image in the window only."""
        key = (width, window)
        if key not in self._levels:
            self._levels[key] = self._make(width, window)
        return self._levels[key]

    def _make(self, width: float, window: Window | None) -> Level:
        left, top, right, bottom = window or (0, 0, self.image.shape[2], self.image.shape[1])
        scale = self.config.coarse_width / width
        resized = _resized(self.image[:, top:bottom, left:right], scale)
        features = self._centred(self.describe(resized))[0]
        colours = colour_cells(resized, features.shape[1:])[0]
        return Level(width, scale, float(left), float(top), features, colours)

    @torch.inference_mode()
    def patches(self, pixels: Tensor, widths: Tensor, cells: int) -> Patches:
        """Patches of `cells` cells a side around pixels (N, 2), for objects of widths (N,).

        What is outside of the image is black.
        """
        views = self._views(pixels, widths, cells * CELL)
        intrinsics = self.frame.intrinsics
        images = torch.stack([
            crop_patch(self.frame.pixels, views[k], intrinsics, size=cells * CELL)
            for k in range(len(pixels))
        ])  # fmt: skip
        described = torch.cat(
            [self.describe(images[k : k + BATCH_SIZE]) for k in range(0, len(images), BATCH_SIZE)]
        )
        return Patches(self._centred(described), patch_to_image(views, intrinsics))

    def background(self, count: int, cells: int, low: float, high: float) -> Patches:
        """Patches at random places, for widths from `low` to `high`: what anything looks like."""
        key = (count, cells, low, high)
        if key not in self._background:
            draw = torch.rand(3, count, generator=torch.Generator().manual_seed(0))
            size = torch.tensor([self.image.shape[2], self.image.shape[1]])
            pixels = draw[:2].T * (size - 1)
            widths = low * (high / low) ** draw[2]
            self._background[key] = self.patches(pixels, widths, cells)
        return self._background[key]

    def _views(self, pixels: Tensor, widths: Tensor, size: int) -> View:
        """Virtual cameras that look at pixels and show what is of a width there as templates do."""
        turn = torch.eye(3, dtype=torch.float64)
        poses = seed_poses(pixels.to(torch.float64), turn, 1.0, widths, self.frame.camera)
        view = look_at(poses, torch.ones(len(pixels), dtype=torch.float64))  # spheres of one metre
        intrinsics = view.intrinsics.clone()
        intrinsics[:, 0, 0] = intrinsics[:, 1, 1] = self.config.width * view.distance
        intrinsics[:, :2, 2] = (size - 1) / 2
        return View(view.rotation, intrinsics, view.distance)

    def _centred(self, described: Tensor) -> Tensor:
        return functional.normalize(described - self.mean[None, :, None, None], dim=1)


def _resized(image: Tensor, scale: float) -> Tensor:
    """An image (3, H, W) scaled, as a batch of one; two cells a side at least."""
    size = [max(2 * CELL, round(length * scale)) for length in image.shape[1:]]
    return functional.interpolate(
        image[None], size=size, mode="bilinear", antialias=True, align_corners=False
    )
