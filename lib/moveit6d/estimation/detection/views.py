"""From which side an object is seen at a place in an image, by its fine templates.

Never refines a pose and never decides whether an object is there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from ...config import MatchConfig
from .places import Place, spread_of
from .pyramid import Patches, Pyramid
from .region import widening
from .templates import Templates

Allowed = Callable[[Tensor, Tensor, Tensor], Tensor]
EDGE = 2  # cells at a patch's edge whose descriptors the edge changes


@dataclass(frozen=True)
class Candidates:
    """`N` proposals, the best first.

    `scores` (N,), `pixels` (N, 2) of the object's centre, `widths` (N,) of its sphere in pixels
    where it as far away on the camera's axis, `views` (N,) which of the templates' rotations.
    """

    scores: Tensor
    pixels: Tensor
    widths: Tensor
    views: Tensor

    def __len__(self) -> int:
        return len(self.scores)

    def __getitem__(self, index: Tensor | slice) -> Candidates:
        """Some of them: a mask, indices or a slice."""
        return Candidates(
            self.scores[index], self.pixels[index], self.widths[index], self.views[index]
        )


class ViewMatcher:
    """One object's fine templates against patches of one image.

    Each view has a position of its own and a size of its own near the place that is asked for:
    that of its best correlation, in units of its mean and spread over patches anywhere in the
    image. The views with the best of these are ranked by a slower score, in which cells may lie one
    cell beside where they should, and a part of the object may be hidden.
    """

    def __init__(self, templates: Templates, pyramid: Pyramid, config: MatchConfig) -> None:
        self.templates, self.pyramid, self.config = templates, pyramid, config
        self.cells = templates.cells + 2 * (config.reach + 1 + EDGE)  # of a patch
        side = min(pyramid.image.shape[1:])
        low, high = (side * share for share in config.widths)
        usual = pyramid.background(config.background, self.cells, low, high)
        windows = self._windows(usual)[..., 1:-1, 1:-1].flatten(0, 1).flatten(1)
        self._spread = spread_of(windows, templates.rows, config.min_spread)

    @torch.inference_mode()
    def views(self, place: Place, allowed: Allowed | None = None) -> Candidates:
        """The best views at a place, each at its own best position and width nearby.

        `allowed` says which pixels (N, 2), widths (N) and views (N) may be; without it all.
        """
        step, reach = self.config.step, self.config.reach
        pixel = torch.tensor(place.pixel)
        width = place.width / float(widening(pixel, self.pyramid.frame.camera))
        widths = torch.tensor([width / step, width, width * step])
        pixels = pixel.expand(len(widths), 2)
        patches = self.pyramid.patches(pixels, widths, self.cells)
        windows = self._windows(patches)
        positions = [
            (*patches.pixel(patch, right, down), float(widths[patch]))
            for patch in range(len(widths))
            for down in range(-reach, reach + 1)
            for right in range(-reach, reach + 1)
        ]
        at = torch.tensor(positions)  # (patches · positions, 3)
        windows = windows.flatten(0, 1)
        mean, deviation = self._spread
        scores = windows[..., 1:-1, 1:-1].flatten(1) @ self.templates.rows.mT
        scores = (scores - mean) / deviation  # (patches · positions, templates)
        if allowed is not None:
            scores = torch.where(_mask(at, scores.shape[1], allowed), scores, -math.inf)
        best, where = scores.max(0)
        views = best.argsort(descending=True)[: self.config.shortlist * self.config.views]
        views = views[best[views].isfinite()]
        agreement = self._agreement(windows[where[views]], views)
        order = agreement.argsort(descending=True)[: self.config.views]
        chosen = at[where[views[order]]]
        return Candidates(agreement[order], chosen[:, :2], chosen[:, 2], views[order])

    def _windows(self, patches: Patches) -> Tensor:
        """All windows of a template and a cell around it: (patches, positions, C, k + 2, k + 2)."""
        inner = self.templates.project(patches.features)[..., EDGE:-EDGE, EDGE:-EDGE]
        size, count = self.templates.cells + 2, 2 * self.config.reach + 1
        return torch.stack([
            inner[..., row : row + size, column : column + size]
            for row in range(count)
            for column in range(count)
        ], 1)  # fmt: skip

    def _agreement(self, windows: Tensor, views: Tensor) -> Tensor:
        """Mean cosine (N,) over that share of each view that agrees best with its window.

        Each cell may match one cell beside where it should.
        """
        k = self.templates.cells
        # Channels last in both: the sum over them is twice as fast.
        kernels = self.templates.kernels[views].permute(0, 2, 3, 1).contiguous()
        windows = windows.permute(0, 2, 3, 1).contiguous()
        products = torch.stack([
            (windows[:, dy : dy + k, dx : dx + k] * kernels).sum(-1)
            for dy in range(3)
            for dx in range(3)
        ])  # fmt: skip
        shares, config = self.templates.shares[views], self.config
        return seen_mean(products.amax(0), shares, config.visible, config.neighbourhood)


def seen_mean(products: Tensor, shares: Tensor, visible: float, cells: int) -> Tensor:
    """Mean (N,) over the share `visible` of each object whose neighbourhoods agree best.

    `products` (N, k, k) are the cells' parts of the mean over all of the object, of which they are
    `shares` (N, k, k). Neighbourhoods of `cells` cells a side (odd), because what hides an object
    lies together.
    """
    near = [
        functional.avg_pool2d(one[:, None], cells, 1, cells // 2).flatten(1)
        for one in (products, shares)
    ]
    there = shares.flatten(1) > 0
    order = torch.where(there, near[0] / (near[1] + 1e-6), -math.inf).argsort(1, descending=True)
    parts, sizes = (one.flatten(1).gather(1, order) for one in (products, shares))
    before = sizes.cumsum(1) - sizes
    taken = ((visible - before) / (sizes + 1e-12)).clamp(0, 1)  # the last cell in part
    return (parts * taken).sum(1) / visible


def _mask(positions: Tensor, views: int, allowed: Allowed) -> Tensor:
    """Which views may be at which positions (P, 3) of pixel and width: (P, views)."""
    count = len(positions)
    every = positions.repeat_interleave(views, 0)
    numbers = torch.arange(views).repeat(count)
    return allowed(every[:, :2], every[:, 2], numbers).reshape(count, views)


def best_candidates(found: Sequence[Candidates], count: int) -> Candidates:
    """The `count` best candidates of all places."""
    if not found:
        none = torch.zeros(0)
        return Candidates(none, none.reshape(0, 2), none, none.long())
    names = ("scores", "pixels", "widths", "views")
    every = Candidates(*(torch.cat([getattr(one, name) for one in found]) for name in names))
    return every[every.scores.argsort(descending=True)[:count]]
