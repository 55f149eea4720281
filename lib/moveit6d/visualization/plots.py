"""Draws the charts of a reproduction as PNG and SVG files.

Never computes a figure. The same chart gives the same file: no dates and no random names in it.
"""

from __future__ import annotations

from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np

from ..io import replacing
from .charts import BarChart, Chart, LineChart, Panel, Sheet

KINDS = ("png", "svg")
DOTS_AN_INCH = 130
LETTER = 0.65 / 72  # inches of a letter's width, a point of the font's size
STYLE: dict[Any, Any] = {
    "svg.hashsalt": "moveit6d",
    "font.size": 9,
    "text.parse_math": False,  # a dollar in the name of a folder or an object is a dollar
    "axes.spines.top": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.alpha": 0.3,
    "legend.frameon": False,
}
COLORS = ("#1f6fb4", "#e07b00", "#4f4f4f", "#a9a9a9", "#2a9d5c", "#b03060")


def files_of_chart(path: Path) -> list[Path]:
    """The files of a chart that is called like the last part of a path, in the folder before it."""
    return [path.parent / f"{path.name}.{kind}" for kind in KINDS]


def draw(chart: Chart, folder: str | Path, data: str = "") -> list[Path]:
    """Write NAME.png and NAME.svg of a chart; the paths written. Each file appears whole.

    `data` says under the chart what our figures were taken on: a chart travels without its page.
    """
    from matplotlib import rc_context

    with rc_context(STYLE):
        figure = _figure(chart, data)
        written = files_of_chart(Path(folder) / chart.name)
        for path in written:
            # An SVG has its date in it unless told otherwise; a PNG has none.
            facts = {"Date": None} if path.suffix == ".svg" else None
            with replacing(path) as temporary:
                figure.savefig(temporary, dpi=DOTS_AN_INCH, metadata=facts)
    return written


def _figure(chart: Chart, data: str) -> Any:
    figure = _sheet(chart) if isinstance(chart, Sheet) else _single(chart)
    if data:
        caption = _wrapped(f"ours: {data}", figure.get_figwidth(), 7)
        figure.supxlabel(caption, fontsize=7, color="#666666")
    return figure


def _single(chart: LineChart | BarChart) -> Any:
    from matplotlib.figure import Figure

    wide = 0.45 * len(chart.categories) + 2 if isinstance(chart, BarChart) else 6.4
    width = max(5.0, wide)
    figure = Figure(figsize=(width, 4.4), layout="constrained")
    axes = figure.add_subplot()
    handles = _bars(axes, chart) if isinstance(chart, BarChart) else _lines(axes, chart)
    axes.set_title(_wrapped(chart.title, width, 11))
    labels = [_wrapped(handle.get_label(), width - 1, 9) for handle in handles]
    longest = max((len(line) for label in labels for line in label.split("\n")), default=0)
    columns = max(1, int(width / (9 * LETTER * longest + 0.6)))  # 0.6: what stands for the curve
    figure.legend(handles, labels, loc="outside upper center", ncols=columns)
    return figure


def _wrapped(text: str, width: float, size: float) -> str:
    """The text in lines of so many inches, in letters of so many points."""
    return fill(text, max(1, int(width / (size * LETTER))))


def _lines(axes: Any, chart: LineChart) -> list[Any]:
    """Curves, which are returned for a legend; those of the right axis are dashed."""
    right = axes.twinx() if any(curve.right for curve in chart.curves) else None
    handles: list[Any] = []
    for number, curve in enumerate(chart.curves):
        place = right if curve.right and right is not None else axes
        style: dict[str, Any] = {"linestyle": "--" if curve.right else "-", "marker": "o"}
        if curve.dots:
            style = {"linestyle": "none", "marker": "*", "markersize": 13}
        style = {"markersize": 3.5, **style}
        color = COLORS[number % len(COLORS)]
        handles += place.plot(curve.x, curve.y, color=color, label=curve.label, **style)
    axes.set_xlabel(chart.x_label)
    axes.set_ylabel(chart.y_label)
    axes.set_ylim(bottom=0)
    if right is not None:
        right.set_ylabel(chart.right_label)
        right.set_ylim(bottom=0)
        right.grid(False)
    return handles


def _bars(axes: Any, chart: BarChart) -> list[Any]:
    """Bars; each series is returned for a legend."""
    width = 0.8 / max(1, len(chart.series))
    places = np.arange(len(chart.categories))
    handles: list[Any] = []
    for number, (name, values) in enumerate(chart.series.items()):
        heights = [np.nan if value is None else value for value in values]
        offset = (number - (len(chart.series) - 1) / 2) * width
        color = COLORS[number % len(COLORS)]
        handles.append(axes.bar(places + offset, heights, width, label=name, color=color))
    many = len(chart.categories) > 6
    axes.set_xticks(
        places, chart.categories, rotation=60 if many else 0, ha="right" if many else "center"
    )
    axes.set_ylabel(chart.y_label)
    axes.grid(axis="x", visible=False)
    return handles


def _sheet(chart: Sheet) -> Any:
    from matplotlib.figure import Figure

    rows = -(-len(chart.panels) // chart.columns)
    plain = all(panel.lines is None and panel.arrows is None for panel in chart.panels)
    side = 2.1 if plain else 4.2
    figure = Figure(figsize=(side * chart.columns, 0.95 * side * rows), layout="constrained")
    for number, panel in enumerate(chart.panels, 1):
        axes = figure.add_subplot(rows, chart.columns, number)
        axes.set_title(_wrapped(panel.title, 0.9 * side, 8), fontsize=8)
        if panel.lines is not None:
            handles = _lines(axes, panel.lines)
            axes.legend(handles=handles, loc="upper center", bbox_to_anchor=(0.5, -0.15), ncols=2)
        else:
            _picture(figure, axes, panel)
    return figure


def _picture(figure: Any, axes: Any, panel: Panel) -> None:
    """A picture with what is marked in it; a heat map gets a bar of its values."""
    axes.grid(False)
    axes.set_xticks([])
    axes.set_yticks([])
    if panel.picture is None:
        axes.set_axis_off()
        return
    color = panel.picture.ndim == 3
    shown = axes.imshow(panel.picture, cmap=None if color else "viridis", interpolation="nearest")
    if not color:
        figure.colorbar(shown, ax=axes, shrink=0.7)
    if panel.arrows is not None:
        x, y, u, v = panel.arrows.T
        axes.quiver(x, y, u, v, color="#ffd400", angles="xy", width=0.003)
    for label, (x, y) in panel.crosses.items():
        axes.plot(x, y, "+", color="#ff2020", markersize=14, markeredgewidth=2, label=label)
    if panel.box is not None:
        left, top, right, bottom = panel.box
        axes.plot(
            [left, right, right, left, left],
            [top, top, bottom, bottom, top],
            color="#ff2020",
            linewidth=1.5,
        )
    if color:
        axes.set_xlim(-0.5, panel.picture.shape[1] - 0.5)
        axes.set_ylim(panel.picture.shape[0] - 0.5, -0.5)
