"""What a chart shows, as data: curves, bars, and sheets of pictures.

Never computes a figure and never draws; `plots` draws.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Curve:
    """Points (x, y) of one line; `right` puts it on a second axis, `dots` draws no line."""

    label: str
    x: tuple[float, ...]
    y: tuple[float, ...]
    right: bool = False
    dots: bool = False


@dataclass(frozen=True)
class LineChart:
    """Curves over one x axis, and perhaps a second y axis on the right."""

    name: str
    title: str
    x_label: str
    y_label: str
    curves: tuple[Curve, ...]
    right_label: str = ""


@dataclass(frozen=True)
class BarChart:
    """Groups of bars: for each series a value a category, None for no bar."""

    name: str
    title: str
    y_label: str
    categories: tuple[str, ...]
    series: Mapping[str, tuple[float | None, ...]]


@dataclass(frozen=True)
class Panel:
    """One picture of a sheet: RGB uint8 (H, W, 3) or a heat map (H, W) of floats.

    `arrows` (N, 4) are x, y and direction, `crosses` (N, 2) marked places, `box` is left, top,
    right, bottom; all in pixels of the picture. `lines` is drawn instead of a picture.
    """

    title: str
    picture: NDArray[Any] | None = None
    arrows: NDArray[np.float64] | None = None
    crosses: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    box: tuple[float, float, float, float] | None = None
    lines: LineChart | None = None


@dataclass(frozen=True)
class Sheet:
    """Pictures beside each other, row by row."""

    name: str
    title: str
    columns: int
    panels: tuple[Panel, ...]


def reliability_diagram(name: str, curves: Mapping[str, tuple[Any, Any]]) -> LineChart:
    """Mean confidence against share of right poses by bin, beside the diagonal.

    `curves` are (confidence, right) by label, each (bins,).
    """
    drawn = [
        Curve(label, tuple(map(float, confidence)), tuple(map(float, right)))
        for label, (confidence, right) in curves.items()
    ]
    return LineChart(
        name, "Reliability", "confidence", "share with ADD(-S) < 10 % of the diameter",
        (*drawn, Curve("calibrated", (0.0, 1.0), (0.0, 1.0))),
    )  # fmt: skip


def motion_chart(
    name: str, speeds: Sequence[float], iterations: Sequence[float], one: Sequence[float]
) -> LineChart:
    """Iterations a frame and the share of frames of one iteration, by pixels a frame; each (N,)."""
    x, y, share = zip(*sorted(zip(speeds, iterations, one, strict=True)), strict=True)
    return LineChart(
        name, "What motion costs", "motion, pixels a frame", "iterations a frame",
        (
            Curve("iterations a frame", x, y),
            Curve("share of frames of one iteration", x, share, right=True),
        ),
        right_label="share of frames",
    )  # fmt: skip


Chart = LineChart | BarChart | Sheet
