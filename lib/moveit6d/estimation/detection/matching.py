"""Dense template matching: where in an image, at which size, from which side.

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
from .templates import CELL, Describe, TemplateBank, Templates, colour_cells

Window = tuple[int, int, int, int]  # left, top, right, bottom in image pixels
Allowed = Callable[[Tensor, Tensor, Tensor], Tensor]


@dataclass(frozen=True)
class Level:
    """An image at the scale at which an object of one width is as wide as the templates.

    `width` is the sphere's in pixels of the image, `scale` the level's pixels an image pixel,
    `left` and `top` the image pixel of the level's corner; `features` (D, h, w) are normalised
    descriptors without their local mean, `colours` (3, h, w) as `colour_cells` has them.
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

    def cell(self, u: float, v: float) -> tuple[float, float]:
        """Place in cells of an image pixel."""
        return (
            (u - self.left + 0.5) * self.scale / CELL - 0.5,
            (v - self.top + 0.5) * self.scale / CELL - 0.5,
        )


@dataclass(frozen=True)
class Candidates:
    """`N` proposals: the best, by their scores, and then the best of all places in turn.

    `scores` (N,), `pixels` (N, 2) of the object's centre, `widths` (N,) of its sphere in pixels,
    `views` (N,) which of the templates' rotations.
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


def ladder(low: float, high: float, step: float) -> list[float]:
    """Widths from `low` to `high` with at most the ratio `step` between neighbours."""
    count = max(1, math.ceil(math.log(max(high / low, 1.0)) / math.log(step) - 1e-6) + 1)
    if count == 1:
        return [math.sqrt(low * high)]
    return [low * (high / low) ** (k / (count - 1)) for k in range(count)]


class Pyramid:
    """The levels of one image (3, H, W) in [0, 1]; each is made once, for all objects in it.

    `local_mean` is that of `MatchConfig`, `width` that of `TemplateConfig`.
    """

    def __init__(self, image: Tensor, describe: Describe, local_mean: int, width: int) -> None:
        self.image, self.describe, self.local_mean, self.width = image, describe, local_mean, width
        self._levels: dict[tuple[float, Window | None], Level] = {}

    @torch.inference_mode()
    def level(self, width: float, window: Window | None = None) -> Level:
        """The level for objects of a width; of the part of the image in the window only."""
        key = (width, window)
        if key not in self._levels:
            self._levels[key] = self._make(width, window)
        return self._levels[key]

    def _make(self, width: float, window: Window | None) -> Level:
        left, top, right, bottom = window or (0, 0, self.image.shape[2], self.image.shape[1])
        part = self.image[None, :, top:bottom, left:right]
        scale = self.width / width
        size = [max(2 * CELL, round(length * scale)) for length in part.shape[2:]]
        resized = functional.interpolate(
            part, size=size, mode="bilinear", antialias=True, align_corners=False
        )
        features = _locally_centred(self.describe(resized), self.local_mean)[0]
        colours = colour_cells(resized, features.shape[1:])[0]
        return Level(width, scale, float(left), float(top), features, colours)


def _locally_centred(features: Tensor, cells: int) -> Tensor:
    """Descriptors (1, D, h, w) without the mean around each cell, normalised."""
    reach = cells // 2
    padded = functional.pad(features, [reach] * 4, mode="replicate")
    mean = functional.avg_pool2d(padded, 2 * reach + 1, 1)
    return functional.normalize(features - mean, dim=1)


class Matcher:
    """One object's templates against the levels of one image.

    Call `add` for every level, then `candidates`. Scores are in units of each template's mean and
    spread over the image: some sides of an object look like anything. `colour` is the weight of the
    colours beside the descriptors.
    """

    def __init__(self, bank: TemplateBank, config: MatchConfig, colour: float) -> None:
        self.bank, self.config, self.colour = bank, config, colour
        self.levels: list[Level] = []
        self._projected: list[Tensor] = []  # (C, h + k - 1, w + k - 1)
        self._coarse: list[Tensor] = []  # (coarse templates, h, w)
        self._background: list[Tensor] = []
        self._random = torch.Generator().manual_seed(0)

    @torch.inference_mode()
    def add(self, level: Level, background_only: bool = False) -> None:
        """Match the coarse templates everywhere in one more level.

        With `background_only` it only tells what the templates' scores usually are.
        """
        k = self.bank.fine.cells
        projected = torch.einsum("dhw,dc->chw", level.features, self.bank.fine.basis)
        channels = torch.cat([projected, self.colour * level.colours])
        padded = functional.pad(channels, [k // 2] * 4)
        self._background.append(_random_windows(padded, k, self.config.samples, self._random))
        if background_only:
            return
        batch = padded[None].contiguous(memory_format=torch.channels_last)
        self.levels.append(level)
        self._projected.append(padded)
        self._coarse.append(functional.conv2d(batch, self.bank.coarse.kernels)[0])

    @torch.inference_mode()
    def candidates(self, allowed: Allowed | None = None) -> Candidates:
        """The best candidates: those of the best places, each with its best views.

        `allowed` says which pixels (N, 2), widths (N) and views (N) may be; without it all.
        """
        windows = torch.cat(self._background)
        fine, coarse = (
            _spread(windows, templates, self.config.min_spread)
            for templates in (self.bank.fine, self.bank.coarse)
        )
        found = [self._views(place, fine, allowed) for place in self._places(coarse)]
        if not found:
            return _gathered([])
        every = _gathered(found)
        count = self.config.candidates
        order = every.scores.argsort(descending=True)
        first, rest = order[:count], order[count:]
        # What comes after the best must not be more of the same places: every place's best views.
        rank = torch.cat([torch.arange(len(some)) for some in found])[rest]
        return every[torch.cat([first, rest[rank.argsort(stable=True)][:count]])]

    def _places(self, spread: tuple[Tensor, Tensor]) -> list[tuple[int, int, int]]:
        """Level, row and column of the best places, thinned over all levels."""
        mean, deviation = (one[:, None, None] for one in spread)
        peaks: list[tuple[float, int, int, int]] = []
        count = self.config.shortlist * self.config.places
        for number, scores in enumerate(self._coarse):
            best = ((scores - mean) / deviation).amax(0)
            top = functional.max_pool2d(best[None, None], 3, 1, 1)[0, 0]
            rows, columns = (best == top).nonzero(as_tuple=True)
            order = best[rows, columns].argsort(descending=True)[:count]
            for i in order.tolist():
                row, column = int(rows[i]), int(columns[i])
                peaks.append((float(best[row, column]), number, row, column))
        peaks.sort(reverse=True)
        chosen: list[tuple[int, int, int]] = []
        for _, number, row, column in peaks:
            if not any(self._same((number, row, column), other) for other in chosen):
                chosen.append((number, row, column))
            if len(chosen) == self.config.places:
                break
        return chosen

    def _same(self, one: tuple[int, int, int], other: tuple[int, int, int]) -> bool:
        (u, v), (p, q) = self._pixel(*one), self._pixel(*other)
        a, b = self.levels[one[0]].width, self.levels[other[0]].width
        near = math.hypot(u - p, v - q) <= self.config.same_place * max(a, b)
        ratio = self.config.same_width
        return near and 1 / ratio < a / b < ratio

    def _pixel(self, level: int, row: int, column: int) -> tuple[float, float]:
        """Image pixel of the centre of a template at a position of the score map."""
        shift = self._shift
        return self.levels[level].pixel(column + shift, row + shift)

    @property
    def _shift(self) -> float:
        """From a position of a score map to the middle of the template there, cells."""
        k = self.bank.fine.cells
        return (k - 1) / 2 - k // 2

    def _views(
        self,
        place: tuple[int, int, int],
        spread: tuple[Tensor, Tensor],
        allowed: Allowed | None,
    ) -> Candidates:
        """The best views at a place, each at its own best position and width nearby."""
        fine, k = self.bank.fine, self.bank.fine.cells
        positions: list[tuple[int, int, int]] = []
        windows = []
        for level in range(max(place[0] - 1, 0), min(place[0] + 2, len(self.levels))):
            padded = self._projected[level]
            rows, columns = (self._around(place, level, axis) for axis in (0, 1))
            if len(rows) == 0 or len(columns) == 0:
                continue
            part = padded[:, rows[0] : rows[-1] + k, columns[0] : columns[-1] + k]
            cut = part.unfold(1, k, 1).unfold(2, k, 1).permute(1, 2, 0, 3, 4)
            windows.append(cut.reshape(len(rows) * len(columns), -1))
            positions += [(level, row, column) for row in rows for column in columns]
        scores = torch.cat(windows) @ fine.rows.mT  # (positions, templates)
        scores = (scores - spread[0]) / spread[1]
        if allowed is not None:
            scores = torch.where(self._mask(positions, scores.shape[1], allowed), scores, -math.inf)
        best, where = scores.max(0)
        views = best.argsort(descending=True)[: self.config.shortlist * self.config.views]
        at = [positions[i] for i in where[views].tolist()]
        total = best[views] + self.config.tolerance_weight * self._tolerant(at, views)
        order = total.argsort(descending=True)[: self.config.views]
        order = order[total[order].isfinite()]
        chosen = [at[i] for i in order.tolist()]
        return Candidates(
            total[order],
            torch.tensor([self._pixel(*one) for one in chosen]).reshape(-1, 2),
            torch.tensor([self.levels[one[0]].width for one in chosen]),
            views[order],
        )

    def _mask(self, positions: list[tuple[int, int, int]], views: int, allowed: Allowed) -> Tensor:
        """Which views may be at which positions: (positions, views)."""
        count = len(positions)
        pixels = torch.tensor([self._pixel(*one) for one in positions])
        widths = torch.tensor([self.levels[one[0]].width for one in positions])
        return allowed(
            pixels.repeat_interleave(views, 0),
            widths.repeat_interleave(views),
            torch.arange(views).repeat(count),
        ).reshape(count, views)

    def _around(self, place: tuple[int, int, int], level: int, axis: int) -> range:
        """Rows (axis 0) or columns (1) of another level's score map around a place."""
        u, v = self._pixel(*place)
        x, y = self.levels[level].cell(u, v)
        middle = round((y, x)[axis] - self._shift)
        size = self._coarse[level].shape[1 + axis]
        reach = self.config.reach
        return range(max(middle - reach, 0), min(middle + reach + 1, size))

    def _tolerant(self, positions: list[tuple[int, int, int]], views: Tensor) -> Tensor:
        """Mean cosine where each cell may match one cell beside where it should: (N,)."""
        k = self.bank.fine.cells
        windows = []
        wide: dict[int, Tensor] = {}
        for level, row, column in positions:
            if level not in wide:
                wide[level] = functional.pad(self._projected[level], [1] * 4)
            windows.append(wide[level][:, row : row + k + 2, column : column + k + 2])
        window, kernels = torch.stack(windows), self.bank.fine.kernels[views]
        products = torch.stack([
            (window[..., dy : dy + k, dx : dx + k] * kernels).sum(1)
            for dy in range(3)
            for dx in range(3)
        ])  # fmt: skip
        return products.amax(0).sum((1, 2))


def _gathered(found: Sequence[Candidates]) -> Candidates:
    if not found:
        none = torch.zeros(0)
        return Candidates(none, none.reshape(0, 2), none, none.long())
    names = ("scores", "pixels", "widths", "views")
    return Candidates(*(torch.cat([getattr(one, name) for one in found]) for name in names))


def _random_windows(padded: Tensor, k: int, count: int, random: torch.Generator) -> Tensor:
    """Windows of k × k cells of a map (C, h, w): (count, C·k·k)."""
    height, width = padded.shape[1] - k + 1, padded.shape[2] - k + 1
    rows = torch.randint(0, height, (count,), generator=random)
    columns = torch.randint(0, width, (count,), generator=random)
    cut = padded.unfold(1, k, 1).unfold(2, k, 1)
    return cut[:, rows, columns].permute(1, 0, 2, 3).reshape(count, -1)


def _spread(windows: Tensor, templates: Templates, least: float) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation (N,) of each template's score over windows of the image.

    The deviation is not less than `least` of its own mean.
    """
    scores = windows @ templates.rows.mT
    deviation = scores.std(0)
    return scores.mean(0), deviation.clamp(min=least * float(deviation.mean()) + 1e-6)
