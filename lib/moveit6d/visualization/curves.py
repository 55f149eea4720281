"""Curves of a run over its frames as one SVG: error, confidence and steps below each other.

Never opens a window and never needs anything from outside: the SVG stands in a page as it is.
"""

from __future__ import annotations

import io
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

INK, BLUE, ORANGE, GREY = "#333333", "#2166ac", "#d6604d", "#999999"
SIZE = (10.0, 1.5)  # inches of one curve
LEFT, RIGHT = 0.07, 0.985  # where the frames begin and end, as shares of the width
MOST = 50.0  # % of the diameter: curves of errors end here


@dataclass(frozen=True)
class Curves:
    """What is drawn over the frames. Unknown numbers are NaN; a curve without numbers is left out.

    `error` in % of the diameter, `confidence` in [0, 1]; `missing` and `resets` are frames.
    """

    frames: Sequence[int]
    error: Sequence[float]
    confidence: Sequence[float]
    iterations: Sequence[float]
    missing: Sequence[int]
    resets: Sequence[int]


def curves_svg(curves: Curves, low_confidence: float) -> str:
    """The SVG's text. Below `low_confidence` a pose is taken to be wrong."""
    import matplotlib
    from matplotlib.figure import Figure

    drawn = {
        "ADD, % of d": curves.error,
        "confidence": curves.confidence,
        "iterations": curves.iterations,
    }
    drawn = {name: values for name, values in drawn.items() if not all(map(math.isnan, values))}
    if not drawn:
        return ""
    settings: Any = {
        "svg.fonttype": "none",
        "svg.hashsalt": "moveit6d",
        "font.family": "sans-serif",
        "font.size": 9,
    }
    with matplotlib.rc_context(settings):
        height = SIZE[1] * len(drawn) + 0.4
        figure = Figure(figsize=(SIZE[0], height))
        figure.subplots_adjust(LEFT, 0.45 / height, RIGHT, 1 - 0.1 / height, hspace=0.12)
        axes = figure.subplots(len(drawn), 1, sharex=True, squeeze=False)[:, 0]
        for axis, (name, values) in zip(axes, drawn.items(), strict=True):
            _draw(axis, name, values, curves, low_confidence)
        axes[-1].set_xlabel("frame")
        axes[-1].set_xlim(*span(curves.frames))
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    whole = text.getvalue()
    return whole[whole.index("<svg") :]  # what stands before it belongs to files only


def span(frames: Sequence[int]) -> tuple[float, float]:
    """What the left and the right end of the curves stand for."""
    return frames[0] - 0.5, frames[-1] + 0.5


def limits(frames: Sequence[int]) -> Mapping[str, float]:
    """How a place in the picture becomes a frame: `LEFT` is `first`, `RIGHT` is `last`."""
    first, last = span(frames)
    return {"left": LEFT, "right": RIGHT, "first": first, "last": last}


def _draw(
    axis: Any, name: str, values: Sequence[float], curves: Curves, low_confidence: float
) -> None:
    axis.set_ylabel(name, color=INK)
    axis.spines[["top", "right"]].set_visible(False)
    axis.tick_params(colors=INK)
    for first, last in _runs(curves.missing):
        axis.axvspan(first - 0.5, last + 0.5, color=ORANGE, alpha=0.25, linewidth=0)
    for frame in curves.resets:
        axis.axvline(frame, color=GREY, linewidth=0.8, linestyle=":")
    if name == "iterations":
        axis.step(curves.frames, values, where="mid", color=INK, linewidth=1.0)
        axis.set_ylim(0, None)
        return
    shown, limit = (values, low_confidence) if name == "confidence" else (_cut(values), 10.0)
    axis.axhline(limit, color=ORANGE, linewidth=0.8, linestyle="--")
    for frames, part in _parts(curves, shown):
        # A line through one point alone cannot be seen.
        axis.plot(frames, part, "." if len(part) == 1 else "-", color=BLUE, linewidth=1.2)
    known = [value for value in shown if not math.isnan(value)]
    axis.set_ylim(0, 1.04 if name == "confidence" else max(15.0, 1.06 * max(known, default=0.0)))


def _parts(curves: Curves, shown: Sequence[float]) -> list[tuple[list[int], list[float]]]:
    """Frames and numbers of each line: it joins what is known and ends at a missing pose."""
    found: list[tuple[list[int], list[float]]] = [([], [])]
    missing = set(curves.missing)
    for frame, value in zip(curves.frames, shown, strict=True):
        if frame in missing:
            found.append(([], []))
        elif not math.isnan(value):
            found[-1][0].append(frame)
            found[-1][1].append(value)
    return [part for part in found if part[0]]


def _cut(values: Sequence[float]) -> list[float]:
    """Errors as drawn: those of a lost track end at the upper edge, no pose at all is a gap."""
    return [min(value, MOST) if math.isfinite(value) else math.nan for value in values]


def _runs(frames: Sequence[int]) -> list[tuple[int, int]]:
    """First and last of every run of frames that follow each other."""
    found: list[tuple[int, int]] = []
    for frame in sorted(frames):
        if found and frame == found[-1][1] + 1:
            found[-1] = (found[-1][0], frame)
        else:
            found.append((frame, frame))
    return found
