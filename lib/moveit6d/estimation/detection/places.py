"""Places in an image that look like an object from some side, by dense template matching.

Never says from which side, never refines a pose and never decides whether an object is there.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional

from ...config import MatchConfig
from .pyramid import Level
from .templates import Templates

# Shares of a template: top, bottom, left and right edge.
Part = tuple[float, float, float, float]
WHOLE: tuple[Part, ...] = ((0.0, 1.0, 0.0, 1.0),)
# Of an object whose other half is hidden, that much more stands out.
HALVES: tuple[Part, ...] = (
    (0.0, 0.5, 0.0, 1.0), (0.5, 1.0, 0.0, 1.0), (0.0, 1.0, 0.0, 0.5), (0.0, 1.0, 0.5, 1.0),
)  # fmt: skip


@dataclass(frozen=True)
class Place:
    """Where the object may be: the `pixel` of its centre and its sphere's `width` in pixels.

    The `score` is minus the logarithm of the number of false alarms: of places as good as this one
    that there would be by chance, up to a constant.
    """

    score: float
    pixel: tuple[float, float]
    width: float

    def same(self, other: Place, config: MatchConfig) -> bool:
        """Whether two places are one."""
        near = config.same_place * max(self.width, other.width)
        ratio = config.same_width
        return (
            math.dist(self.pixel, other.pixel) <= near
            and 1 / ratio < self.width / other.width < ratio
        )


class PlaceFinder:
    """One object's coarse templates against the levels of one image.

    Call `add` for every level, then `places`. A template's matches are in units of their mean and
    spread over the image: some sides of an object look like anything. `colour` is the weight of the
    colours beside the descriptors. Of several `parts` of the templates the best one counts.
    """

    def __init__(
        self,
        templates: Templates,
        config: MatchConfig,
        colour: float,
        parts: Sequence[Part] = WHOLE,
    ) -> None:
        self.templates, self.config, self.colour = templates, config, colour
        self.levels: list[Level] = []
        self.usual: list[Level] = []  # levels that only tell what scores usually are
        self._kernels = [_part_of(templates.kernels, part) for part in parts]
        self._scores: list[list[Tensor]] = []  # of each level, of each part: (templates, h, w)
        self._background: list[Tensor] = []
        self._random = torch.Generator().manual_seed(0)

    @torch.inference_mode()
    def add(self, level: Level, background_only: bool = False) -> None:
        """Match the templates everywhere in one more level.

        With `background_only` it only tells what the templates' scores usually are.
        """
        k = self.templates.cells
        projected = self.templates.project(level.features[None])
        channels = torch.cat([projected, self.colour * level.colours[None]], 1)
        padded = functional.pad(channels, [k // 2] * 4)
        self._background.append(_random_windows(padded[0], k, self.config.samples, self._random))
        (self.usual if background_only else self.levels).append(level)
        if not background_only:
            batch = padded.contiguous(memory_format=torch.channels_last)
            self._scores.append([_correlation(batch, one, k) for one in self._kernels])

    @torch.inference_mode()
    def places(self, count: int, known: Sequence[Place] = ()) -> list[Place]:
        """The best places beside the `known` ones, `count` at most, thinned over all levels."""
        windows, least = torch.cat(self._background), self.config.min_spread
        usual = [spread_of(windows, one.whole.flatten(1), least) for one in self._kernels]
        shift = (self.templates.cells - 1) / 2 - self.templates.cells // 2  # to a template's middle
        peaks: list[Place] = []
        for level, parts in zip(self.levels, self._scores, strict=True):
            significant = [
                ((scores - mean[:, None, None]) / deviation[:, None, None]).amax(0)
                for scores, (mean, deviation) in zip(parts, usual, strict=True)
            ]
            best = _significance(torch.stack(significant).amax(0))
            top = functional.max_pool2d(best[None, None], 3, 1, 1)[0, 0]
            rows, columns = (best == top).nonzero(as_tuple=True)
            values = best[rows, columns]
            most = self.config.shortlist * (count + len(known))
            for i in values.argsort(descending=True)[:most]:
                pixel = level.pixel(float(columns[i]) + shift, float(rows[i]) + shift)
                peaks.append(Place(float(values[i]), pixel, level.width))
        peaks.sort(key=lambda place: -place.score)
        chosen = list(known)
        for place in peaks:
            if not any(place.same(other, self.config) for other in chosen):
                chosen.append(place)
            if len(chosen) == len(known) + count:
                break
        return chosen[len(known) :]


@dataclass(frozen=True)
class _Kernels:
    """A part of all templates: cut out, as `whole` with zeros around it, and where it lies.

    `cut` (N, C, a, b) begins `top` cells from the upper edge of a template and `left` from its left
    one; `whole` is (N, C, k, k).
    """

    cut: Tensor
    whole: Tensor
    top: int
    left: int


def _part_of(kernels: Tensor, part: Part) -> _Kernels:
    """A part of kernels (N, C, k, k)."""
    top, bottom, left, right = (round(edge * kernels.shape[-1]) for edge in part)
    rows, columns = slice(top, bottom), slice(left, right)
    whole = torch.zeros_like(kernels)
    whole[..., rows, columns] = kernels[..., rows, columns]
    cut = kernels[..., rows, columns].contiguous(memory_format=torch.channels_last)
    return _Kernels(cut, whole, top, left)


def _correlation(padded: Tensor, part: _Kernels, k: int) -> Tensor:
    """Scores (N, h, w) of a part of templates of k × k cells everywhere in maps (1, C, H, W)."""
    height, width = (side - k + 1 for side in padded.shape[2:])
    rows = slice(part.top, part.top + height + part.cut.shape[2] - 1)
    columns = slice(part.left, part.left + width + part.cut.shape[3] - 1)
    return functional.conv2d(padded[..., rows, columns], part.cut)[0]


def _significance(scores: Tensor) -> Tensor:
    """Minus the logarithm of the number of false alarms of `scores` (h, w), up to a constant.

    That is how many of them would be as high by chance (a-contrario detection); they are in units
    of their spread, and taken for normal. The narrower the object, the more places there are, and
    the higher the best of them.
    """
    return 0.5 * scores * scores.abs() - math.log(scores.numel())


def _random_windows(padded: Tensor, k: int, count: int, random: torch.Generator) -> Tensor:
    """Windows of k × k cells of a map (C, h, w): (count, C·k·k)."""
    height, width = padded.shape[1] - k + 1, padded.shape[2] - k + 1
    rows = torch.randint(0, height, (count,), generator=random)
    columns = torch.randint(0, width, (count,), generator=random)
    cut = padded.unfold(1, k, 1).unfold(2, k, 1)
    return cut[:, rows, columns].permute(1, 0, 2, 3).reshape(count, -1)


def spread_of(windows: Tensor, rows: Tensor, least: float) -> tuple[Tensor, Tensor]:
    """Mean and standard deviation (N,) of scores of kernels' `rows` (N, n) over windows (M, n).

    The deviation is not less than `least` of its own mean.
    """
    scores = windows @ rows.mT
    deviation = scores.std(0)
    return scores.mean(0), deviation.clamp(min=least * float(deviation.mean()) + 1e-6)
