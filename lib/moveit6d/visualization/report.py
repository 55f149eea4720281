"""A run on one page: facts, curves, pictures of the way and of the worst frames, every frame.

Never tracks and never scores: rows, errors and facts come from whoever did. The page is one HTML
file that needs no other file and no network.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol

from ..datasets.pose_files import PoseRow
from ..datasets.video import FrameSource
from ..errors import InputError
from ..estimation.states import Event, TrackingState
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..io import replacing
from ..rendering.renderer import Renderer
from . import html_template
from .curves import Curves, curves_svg, limits
from .snapshots import Look, as_data, draw, evenly, fetch, near, worst
from .states import bands, events_of, one_per_loss

STILLS = 12  # pictures of the way, and of the worst frames
LOST_STILLS = 4  # of the latter, those without a pose or of a lost object, at most
TOLD = ("probability", "state")  # columns for what some trackers say and others do not
WRONG = 0.10  # share of the diameter: errors above it are shown as bad


class PoseErrors(Protocol):
    """The errors of one frame: ADD and origin in metres, rotation in degrees; infinite: no pose."""

    @property
    def add(self) -> float:
        """Mean distance of the object's points."""

    @property
    def translation(self) -> float:
        """Distance of the origins."""

    @property
    def rotation(self) -> float:
        """Angle between the rotations."""


@dataclass(frozen=True)
class Run:
    """What a report is made from. Everything by frame is keyed by frame number.

    `frames` are read a second time for the pictures; `truth` and `errors` are empty where nobody
    knows the true poses; `failures` say why a frame has no pose; `facts` are shown as they are;
    a confidence below `low_confidence` is shown as bad.
    """

    title: str
    verdict: str
    mesh: Mesh
    camera: Camera
    frames: FrameSource
    rows: Mapping[int, PoseRow]
    facts: Mapping[str, str] = field(default_factory=dict)
    truth: Mapping[int, Pose] = field(default_factory=dict)
    errors: Mapping[int, PoseErrors] = field(default_factory=dict)
    failures: Mapping[int, str] = field(default_factory=dict)
    low_confidence: float = 0.5

    @cached_property
    def badness(self) -> dict[int, float]:
        """How bad each frame is, largest first to be shown.

        No pose is worst; then errors where the truth is known, below them what the probability
        says, or the confidence; a pose that was given, as the first one, comes last.
        """
        return {frame: self._badness(frame) for frame in self.rows}

    def _badness(self, frame: int) -> float:
        row = self.rows[frame]
        if row.pose is None:
            return math.inf
        if frame in self.errors:
            return self.errors[frame].add / self.mesh.diameter
        sure = row.confidence if row.probability is None else row.probability
        return -math.inf if sure is None else (0.0 if self.errors else 1.0) - sure

    def confident(self, frame: int) -> bool:
        """Whether the object is tracked; without states whether its confidence is not low."""
        row = self.rows[frame]
        if row.state:
            return row.pose is not None and row.state == TrackingState.TRACKING
        return row.pose is not None and (
            row.confidence is None or row.confidence >= self.low_confidence
        )

    def bad(self, frame: int) -> bool:
        """Whether the frame is shown in red: wrong if the truth is known, else not confident."""
        if frame in self.errors:
            return not self.errors[frame].add < WRONG * self.mesh.diameter
        return not self.confident(frame)


def write_report(path: str | Path, run: Run, renderer: Renderer) -> None:
    """Write the page, atomically. `InputError` if there is no frame or it cannot be written."""
    text = report_page(run, renderer)
    with replacing(Path(path)) as temporary:
        temporary.write_text(text, encoding="utf-8")


def report_page(run: Run, renderer: Renderer) -> str:
    """The text of the page: one HTML document with everything in it."""
    frames = sorted(run.rows)
    if not frames:
        raise InputError("a report needs at least one frame.")
    # Beyond a diameter it does not matter how far: the moment of losing it comes before the end.
    badness = {
        frame: min(value, 1.0) if value < math.inf else value
        for frame, value in run.badness.items()
    }
    way = evenly(frames, STILLS)
    bad = worst(one_per_loss(badness, run.rows, LOST_STILLS), STILLS)
    whole, close = _pictures(run, set(way), set(bad), renderer)
    curves, events = _curves(run, frames), events_of(run.rows)
    return html_template.render_page(
        title=run.title,
        verdict=run.verdict,
        facts=run.facts,
        curves=curves_svg(curves, run.low_confidence),
        limits=limits(frames),
        bands=bands(events, limits(frames)),
        key=_key(run),
        galleries=[
            ("The way", "Frames evenly spread over the video.", [whole[f] for f in way]),
            ("Worst frames first", _near_key(run), [close[f] for f in bad]),
        ],
        tables=[*([_events_table(events)] if events else []), _table(run)],
    )


def index_page(title: str, verdict: str, text: str, table: Mapping[str, Any]) -> str:
    """The text of a page that leads to others: tables as `text`, and one table with links.

    `table` has `heading`, `head` (names) and `rows`, each a list of cells; a cell is a text or a
    pair of text and address.
    """

    def cells(row: Sequence[str | tuple[str, str]]) -> list[dict[str, Any]]:
        return [{**_cell(cell), "text": k == 0} for k, cell in enumerate(row)]

    rows = [{"bad": False, "state": "", "cells": cells(row)} for row in table["rows"]]
    head = cells(table["head"])
    shown = {"heading": table["heading"], "frames": False, "head": head, "rows": rows}
    return html_template.render_page(title=title, verdict=verdict, text=text, tables=[shown])


def _pictures(
    run: Run, way: set[int], bad: set[int], renderer: Renderer
) -> tuple[dict[int, dict[str, Any]], dict[int, dict[str, Any]]]:
    """Whole frames of the way and windows of the bad frames, in one pass through the video."""
    whole: dict[int, dict[str, Any]] = {}
    close: dict[int, dict[str, Any]] = {}
    for frame in fetch(run.frames, way | bad):
        if frame.index in way:
            whole[frame.index] = _picture(run, frame.index, frame.image, renderer)
        if frame.index in bad:
            close[frame.index] = _picture(run, frame.index, frame.image, renderer, near_view=True)
    # Frames that the video does not give again are black.
    whole |= {frame: _picture(run, frame, None, renderer) for frame in way - set(whole)}
    close |= {frame: _picture(run, frame, None, renderer) for frame in bad - set(close)}
    return whole, close


def _picture(
    run: Run, frame: int, image: Any, renderer: Renderer, near_view: bool = False
) -> dict[str, Any]:
    truth = run.truth.get(frame) if near_view else None
    look = Look(run.rows[frame], run.confident(frame), truth)
    drawn = draw(image, look, run.mesh, run.camera, renderer)
    if near_view and image is not None:
        drawn = near(drawn, look, run.mesh, run.camera)
    return {
        "frame": frame,
        "data": as_data(drawn),
        "bad": run.bad(frame),
        "state": run.rows[frame].state,
        "caption": _says(run, frame),
    }


def _says(run: Run, frame: int) -> str:
    """The frame in a few words."""
    row, words = run.rows[frame], []
    if frame in run.errors and row.pose is not None:
        error = run.errors[frame]
        words.append(f"ADD {1000 * error.add:.1f} mm ({100 * error.add / run.mesh.diameter:.1f} %)")
    if row.pose is None:
        words.append(run.failures.get(frame, "no pose").rstrip("."))
    elif row.state and row.state != TrackingState.TRACKING:
        words.append(row.state)
    if row.confidence is not None:
        words.append(f"confidence {row.confidence:.2f}")
    if row.iterations is not None:
        words.append(f"{row.iterations} iteration{'s' if row.iterations != 1 else ''}")
    if row.stopped_by and row.pose is not None:
        words.append(row.stopped_by)
    return ", ".join(words) if words else "given"


def _curves(run: Run, frames: Sequence[int]) -> Curves:
    rows = [run.rows[frame] for frame in frames]
    return Curves(
        frames=frames,
        error=[
            100 * run.errors[frame].add / run.mesh.diameter if frame in run.errors else math.nan
            for frame in frames
        ],
        confidence=[math.nan if row.confidence is None else row.confidence for row in rows],
        iterations=[math.nan if row.iterations is None else row.iterations for row in rows],
        missing=[row.frame for row in rows if row.pose is None],
        resets=[row.frame for row in rows if row.reset],
    )


def _key(run: Run) -> str:
    words = ["Broken lines: limits of what counts as right.", "Shaded: frames without a pose."]
    if any(row.state for row in run.rows.values()):
        words.append("Bands and the strip below: uncertain in yellow, lost in red.")
    if any(row.reset for row in run.rows.values()):
        words.append("Dotted: set to the true pose.")
    return " ".join([*words, "Move over the curves to read a frame, click to find it below."])


def _near_key(run: Run) -> str:
    told = any(row.state for row in run.rows.values())
    red = "not tracked" if told else "low confidence"
    known = "true contour in white" if run.errors else "the true poses are not known"
    return f"Estimate in green (red: {red}), {known}. Of each loss one frame."


def _table(run: Run) -> dict[str, Any]:
    """Every frame, the worst first."""
    truth = ["ADD mm", "ADD % d", "origin mm", "rotation °"] if run.errors else []
    every = run.rows.values()
    told = [name for name in TOLD if any(getattr(row, name) not in ("", None) for row in every)]
    head = ["frame", *truth, "confidence", *told, "iterations", "stopped by", "ms", "what happened"]
    order = sorted(run.rows, key=lambda frame: (-run.badness[frame], frame))
    rows = []
    for frame in order:
        row = run.rows[frame]
        cells = [str(frame), *(_errors(run, frame) if truth else [])]
        said = {"probability": _number(row.probability, 2), "state": row.state}
        cells += [_number(row.confidence, 2), *(said[name] for name in told)]
        cells += [_number(row.iterations, 0), row.stopped_by]
        cells += [_number(row.milliseconds, 1), _happened(run, row)]
        rows.append(
            {
                "frame": frame,
                "bad": run.bad(frame),
                "state": row.state,
                "says": f"frame {frame}: {_says(run, frame)}",
                "cells": _texts(cells, head),
            }
        )
    return {"heading": "Every frame", "frames": True, "head": _texts(head, head), "rows": rows}


def _events_table(events: Sequence[Event]) -> dict[str, Any]:
    """Which state lasted from which frame to which."""
    head = ["state", "first frame", "last frame", "frames"]
    rows = []
    for event in events:
        first, last = event["first"], event["last"]
        ends = [(str(frame), f"#f{frame}") for frame in (first, last)]
        cells = _texts([event["state"], *ends, str(last - first + 1)], head)
        rows.append({"bad": False, "state": event["state"], "cells": cells})
    return {"heading": "States", "frames": False, "head": _texts(head, head), "rows": rows}


def _errors(run: Run, frame: int) -> list[str]:
    if frame not in run.errors:
        return [""] * 4
    if run.rows[frame].pose is None:
        return ["no pose", "", "", ""]
    error = run.errors[frame]
    share = 100 * error.add / run.mesh.diameter
    return [
        f"{1000 * error.add:.1f}",
        f"{share:.1f}",
        f"{1000 * error.translation:.1f}",
        f"{error.rotation:.2f}",
    ]


def _happened(run: Run, row: PoseRow) -> str:
    words = [run.failures[row.frame]] if row.frame in run.failures else []
    return "; ".join([*words, *["set to the true pose"] * row.reset])


def _texts(cells: Sequence[str | tuple[str, str]], head: Sequence[str]) -> list[dict[str, Any]]:
    words = ("state", "stopped by", "what happened")
    found = [_cell(cell) for cell in cells]
    for cell, name in zip(found, head, strict=True):
        cell["text"] = name in words
    return found


def _cell(cell: str | tuple[str, str]) -> dict[str, Any]:
    shown, link = cell if isinstance(cell, tuple) else (cell, "")
    return {"shown": shown, "link": link, "text": False}


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}f}"
