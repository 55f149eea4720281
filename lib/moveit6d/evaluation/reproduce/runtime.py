"""The paper's runtime table: milliseconds of one iteration, and of a frame.

Never hides the rendering: the paper's figures leave it out, ours are given with and without.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ...visualization.charts import BarChart
from ..iteration_timing import IterationTimes
from . import published_figures as published
from .reproduction import Cell, Reproduction, Table, mean
from .tracks import ScoredTrack

PREPARE = ("crop", "observe")


def reproduction(
    times: IterationTimes, tracks: Sequence[ScoredTrack], data: str, facts: Mapping[str, object]
) -> Reproduction:
    """Table `tab:runtime`; with tracks also what a frame takes."""
    prepare = sum(times.parts[part] for part in PREPARE)
    render, move = times.parts["render"], times.parts["move"]
    network = times.parts["network"]
    without = times.total - render
    printed = list(published.RUNTIME_MS.values())
    rows: list[tuple[Cell, ...]] = [
        ("image preprocessing (crop, resize)", prepare, printed[0]),
        ("network", network, printed[1]),
        ("moving the pose", move, None),
        ("iteration without rendering", without, printed[2]),
        ("rendering", render, None),
        ("whole iteration, rendering too", times.whole, None),
    ]
    tables = [
        Table("iteration", "One iteration (tab:runtime)", ("ms", "ours", "paper"), tuple(rows))
    ]
    if tracks:
        tables.append(_frames(tracks, without))
    chart = BarChart(
        "runtime",
        "One iteration",
        "ms",
        ("preprocessing", "network", "moving", "rendering"),
        {"ours": (prepare, network, move, render), "paper": (printed[0], printed[1], None, None)},
    )
    notes = (
        "Ours is the median of the iterations, all on the CPU; the paper's network ran on a GPU.",
        *published.NOTES["tab:runtime"],
    )
    return Reproduction(
        "runtime",
        "Runtime of an iteration",
        data,
        tuple(tables),
        (chart,),
        notes,
        facts,
    )


def _frames(tracks: Sequence[ScoredTrack], iteration: float) -> Table:
    """Iterations and milliseconds a frame, as tracked under the paper's protocol.

    Of the frames that were counted: one that could not be read took none.
    """
    rows: list[tuple[Cell, ...]] = []
    parts = {track.video.name: [track] for track in tracks}
    for name, part in [*parts.items(), ("all frames", tracks)]:
        iterations = [number for track in part for number in track.iterations]
        mine = mean(iterations)
        spent = None if mine is None else mine * iteration
        measured = mean([time for track in part for time in track.milliseconds])
        rows.append((name, len(iterations), mine, spent, measured))
    rows.append(
        (
            "paper (YCB-Video)",
            None,
            published.ACTIONS_PER_FRAME,
            published.MS_PER_FRAME,
            None,
        )
    )
    head = ("sequence", "frames", "iterations a frame", "ms, iterations × iteration", "ms measured")
    return Table("frames", "What a frame takes", head, tuple(rows))
