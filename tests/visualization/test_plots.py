"""Charts become PNG and SVG files; the same chart gives the same file."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure
from PIL import Image

from moveit6d.visualization.charts import (
    BarChart,
    Chart,
    Curve,
    LineChart,
    Panel,
    Sheet,
    motion_chart,
)
from moveit6d.visualization.plots import draw

LINES = LineChart(
    "lines", "Lines", "m", "%",
    (Curve("left one", (0, 1, 2), (1, 5, 3)), Curve("steps", (0, 1), (30, 20), right=True),
     Curve("stated", (1,), (4,), dots=True)),
    "steps",
)  # fmt: skip
BARS = BarChart("bars", "Bars", "mm", ("cup", "pan"), {"ours": (1.0, None), "paper": (2.0, 3.0)})
SHEET = Sheet(
    "sheet", "Sheet", 2,
    (
        Panel("field", np.full((40, 60, 3), 90, np.uint8), np.array([[10, 10, 1, 0.0]]),
              {"centre": (30, 20)}, (20, 10, 40, 30)),
        Panel("heat", np.arange(12.0).reshape(3, 4)),
        Panel("curve", lines=LINES),
        Panel("empty"),
    ),
)  # fmt: skip


@pytest.mark.parametrize("chart", [LINES, BARS, SHEET], ids=lambda chart: chart.name)
def test_both_files_are_written_and_can_be_read(chart: Chart, tmp_path: Path) -> None:
    png, svg = draw(chart, tmp_path / "new")
    assert [png.name, svg.name] == [f"{chart.name}.png", f"{chart.name}.svg"]
    picture = np.asarray(Image.open(png).convert("RGB"))
    assert min(picture.shape[:2]) > 300 and len(np.unique(picture.reshape(-1, 3), axis=0)) > 20
    assert ET.parse(svg).getroot().tag.endswith("svg")


def test_the_same_chart_gives_the_same_file(tmp_path: Path) -> None:
    first, second = draw(LINES, tmp_path / "a")[1], draw(LINES, tmp_path / "b")[1]
    assert first.read_bytes() == second.read_bytes()


def test_labels_are_in_the_picture(tmp_path: Path) -> None:
    from matplotlib import rc_context

    with rc_context({"svg.fonttype": "none"}):
        text = draw(LINES, tmp_path)[1].read_text(encoding="utf-8")
    for word in ("left one", "steps", "stated", "Lines"):
        assert word in text


def test_dollars_are_dollars(tmp_path: Path) -> None:
    from dataclasses import replace

    from matplotlib import rc_context

    chart = replace(LINES, title="a$^$")
    with rc_context({"svg.fonttype": "none"}):
        text = draw(chart, tmp_path, "set$1_$2")[1].read_text(encoding="utf-8")
    assert "a$^$" in text and "ours: set$1_$2" in text


def test_a_chart_says_what_its_figures_were_taken_on(tmp_path: Path) -> None:
    drawn = draw(LINES, tmp_path, "surrogate for Laval")[1].read_text(encoding="utf-8")
    assert "<!-- ours: surrogate for Laval -->" in drawn
    plain = draw(LINES, tmp_path)[1].read_text(encoding="utf-8")
    assert "surrogate" not in plain


LONG = "surrogate (in YCB-Video's format, not recognised as the published set), folder " + "x" * 90
CASE = Panel("0050.035_power_drill_occlusion_h_45, frame 1003", np.zeros((9, 9, 3), np.uint8))
WIDE = [
    LINES,
    LineChart("paths", "t" * 120, "m", "%", (Curve("/a/path/" * 20, (0, 1), (0, 1)),)),
    BARS,
    BarChart("many", "Bars", "% of frames below 10 % of the diameter",
        tuple(f"{k:03}_a_very_long_name" for k in range(9)), {
        "ours": (1.0,) * 9, "ours + shift (oracle)": (2.0,) * 9, "paper": (3.0,) * 9}),
    SHEET,
    Sheet("cases", "Cases", 3, (CASE, CASE, Panel("15000 steps (mixed_small)", np.eye(3)))),
]  # fmt: skip


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch) -> list[Figure]:
    """The figures that are drawn."""
    found: list[Figure] = []
    save = Figure.savefig

    def keep(self: Figure, *args: Any, **options: Any) -> None:
        found.append(self)
        save(self, *args, **options)

    monkeypatch.setattr(Figure, "savefig", keep)
    return found


@pytest.mark.parametrize("chart", WIDE, ids=lambda chart: chart.name)
def test_nothing_is_cut_or_drawn_over_curves(
    chart: Chart, tmp_path: Path, drawn: list[Figure]
) -> None:
    draw(chart, tmp_path, LONG)
    figure = drawn[0]
    figure.draw_without_rendering()
    room = figure.bbox.padded(1)
    axes = figure.axes
    titles = [one.title.get_window_extent() for one in axes if one.title.get_text()]
    legends = [*figure.legends, *filter(None, (one.get_legend() for one in axes))]
    boxes = [legend.get_window_extent() for legend in legends]
    labels = [text.get_window_extent() for one in axes
              for text in (one.xaxis.label, one.yaxis.label) if text.get_text()]  # fmt: skip
    captions = [text.get_window_extent() for text in figure.texts]
    assert captions
    everything = figure.get_tightbbox().transformed(figure.dpi_scale_trans)
    for box in (everything, *titles, *boxes, *labels, *captions):
        assert room.containsx(box.x0) and room.containsx(box.x1)
        assert room.containsy(box.y0) and room.containsy(box.y1)
    for box in boxes:
        assert not any(box.overlaps(one.bbox) for one in axes)
    for number, box in enumerate(titles):
        assert not any(box.overlaps(other) for other in titles[:number])


def test_what_motion_costs_is_drawn_in_order_of_speed() -> None:
    chart = motion_chart("motion", [5.0, 0.0, 1.0], [1.5, 1.0, 2.0], [0.5, 1.0, 0.0])
    iterations, one = chart.curves
    assert iterations.x == one.x == (0.0, 1.0, 5.0)
    assert iterations.y == (1.0, 2.0, 1.5) and one.y == (1.0, 0.0, 0.5)
    assert one.right and not iterations.right
