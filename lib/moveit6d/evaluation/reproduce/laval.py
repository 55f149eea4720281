"""The paper's Laval tables: mean translation and rotation error by object and occlusion level.

Never changes Laval's own rules: the benchmark's rotation error, resets every 15 frames, frames on
which the pose is given left out; the angle itself stands beside it.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...datasets.sequences import Sequence as Video
from ...errors import InputError
from ...visualization.charts import Curve, LineChart
from .. import metrics
from . import published_figures as published
from .reproduction import Cell, Reproduction, Table, mean, median
from .tracks import ScoredTrack

GROUPS = {f"occlusion_{level}": level for level in published.LAVAL_LEVELS}
NOTES = (
    "Horizontal and vertical occluders of a level are merged, as the benchmark's authors do.",
    "R is the benchmark's own rotation error, which is not quite the angle; the table of angles "
    "has that one.",
    "A frame without a pose counts with the last pose before it.",
    "Means are over the objects of which all columns have figures (columns without any aside); "
    "where the paper prints none of ours, over ours.",
)


@dataclass(frozen=True)
class Cells:
    """Frames (N,) of one object at one level: errors, and the iterations that they took.

    Errors are metres, official degrees and degrees of the angle; None is a frame of which nobody
    counted iterations. `failures` are those of all its tracks.
    """

    translation: Tensor
    official: Tensor
    angle: Tensor
    iterations: tuple[int | None, ...]
    failures: int


Figures = Mapping[tuple[str, int], Cells]  # by object and level


def occlusion_videos(videos: Iterable[Video]) -> list[Video]:
    """The sequences of the levels that the paper reports; `InputError` if there is none."""
    found = [video for video in videos if video.group in GROUPS]
    if not found:
        raise InputError(
            "There is no sequence of a level that the paper reports: OBJECT_occlusion_0, "
            "OBJECT_occlusion_h_15 … OBJECT_occlusion_v_45."
        )
    return found


def measure(tracks: Iterable[ScoredTrack]) -> dict[tuple[str, int], Cells]:
    """Errors by object and level over all of its sequences."""
    found: dict[tuple[str, int], list[ScoredTrack]] = {}
    for track in tracks:
        found.setdefault((track.video.object, GROUPS[track.video.group]), []).append(track)
    return {
        key: Cells(
            torch.cat([metrics.translation_error(t.estimate, t.truth) for t in group]),
            torch.cat([metrics.laval_rotation_error(t.estimate, t.truth) for t in group]),
            torch.cat([metrics.rotation_error(t.estimate, t.truth) for t in group]),
            tuple(itertools.chain.from_iterable(t.iterations for t in group)),
            sum(map(_failures, group)),
        )
        for key, group in found.items()
    }


def _failures(track: ScoredTrack) -> int:
    """Of one track; a run of bad frames ends where frames are not scored, as at a given pose."""
    translation = metrics.translation_error(track.estimate, track.truth)
    official = metrics.laval_rotation_error(track.estimate, track.truth)
    ends = [k for k, (a, b) in enumerate(itertools.pairwise(track.frames), 1) if b > a + 1]
    parts = zip(translation.tensor_split(ends), official.tensor_split(ends), strict=True)
    return sum(metrics.laval_failures(*part) for part in parts)


def reproduction(
    models: Mapping[str, Figures], data: str, facts: Mapping[str, object]
) -> Reproduction:
    """Table `tab:laval_additional` (and with it `tab:laval`), one model a key of `LAVAL_MODELS`."""
    objects = sorted({name for figures in models.values() for name, _ in figures})
    objects += [name for name in published.LAVAL_OBJECTS if name not in objects]
    main = _main(models, objects)
    angles = _spread(models, objects)
    return Reproduction(
        "laval",
        "Laval tables: errors by object and occlusion level",
        data,
        (main, angles),
        tuple(_chart(models, measure_) for measure_ in ("translation", "rotation")),
        (*NOTES, *published.NOTES["tab:laval_additional"]),
        facts,
    )


def _main(models: Mapping[str, Figures], objects: list[str]) -> Table:
    columns = [
        (model, level) for model in published.LAVAL_MODELS for level in published.LAVAL_LEVELS
    ]
    head = ["object", "error"]
    head += [f"ours {model} {level} %" for model, level in columns]
    head += [f"paper {model} {level} %" for model, level in columns]
    rows: list[tuple[Cell, ...]] = []
    for name in objects:
        for quantity, unit in (("translation", "T mm"), ("rotation", "R deg")):
            ours = [_ours(models, m, name, level, quantity) for m, level in columns]
            theirs = [_printed(m, name, level, quantity) for m, level in columns]
            rows.append((name, unit, *ours, *theirs))
    return Table(
        "errors",
        "Mean errors by object and share occluded (tab:laval, tab:laval_additional)",
        tuple(head),
        (*rows, *_means(rows)),
    )


def _means(rows: Sequence[tuple[Cell, ...]]) -> list[tuple[Cell, ...]]:
    """The last two rows, over the same objects in all columns (`NOTES`); rows go in pairs."""
    cells = np.array([row[2:] for row in rows], np.float64)  # None becomes not a number
    shown = cells.shape[1]
    chosen = _complete(cells)
    if not len(chosen):
        shown //= 2  # ours, which come first
        chosen = _complete(cells[:, :shown])
    if not len(chosen):
        return []
    cells[:, shown:] = np.nan
    name = f"mean of {len(chosen)} object" + "s" * (len(chosen) != 1)
    means = (cells[k::2][chosen].mean(0).tolist() for k in (0, 1))
    return [
        (name, unit, *(value if math.isfinite(value) else None for value in values))
        for unit, values in zip(("T mm", "R deg"), means, strict=True)
    ]


def _complete(cells: NDArray[np.float64]) -> NDArray[np.intp]:
    """The objects that have figures in all columns in which any has, of pairs of rows."""
    known = np.isfinite(cells[::2])
    return np.flatnonzero(known[:, known.any(0)].all(1))


def _spread(models: Mapping[str, Figures], objects: list[str]) -> Table:
    """What the paper's table does not show of ours: frames, medians, angles, failures."""
    rows: list[tuple[Cell, ...]] = []
    for model, figures in models.items():
        for name in objects:
            for level in published.LAVAL_LEVELS:
                cells = figures.get((name, level))
                if cells is None:
                    continue
                rows.append(
                    (
                        name,
                        model,
                        level,
                        len(cells.angle),
                        1000 * float(cells.translation.median()),
                        float(cells.official.median()),
                        float(cells.angle.mean()),
                        float(cells.angle.median()),
                        median(cells.iterations),
                        cells.failures,
                    )
                )
    head = (
        "object",
        "model",
        "occluded %",
        "frames",
        "median T mm",
        "median R deg",
        "mean angle deg",
        "median angle deg",
        "median iterations",
        "failures",
    )
    return Table("more", "Ours in other figures", head, tuple(rows))


def _ours(
    models: Mapping[str, Figures], model: str, name: str, level: int, quantity: str
) -> float | None:
    cells = models.get(model, {}).get((name, level))
    if cells is None:
        return None
    if quantity == "translation":
        return 1000 * float(cells.translation.mean())
    return float(cells.official.mean())


def _printed(model: str, name: str, level: int, quantity: str) -> float | None:
    figure = published.LAVAL.get((model, name, level))
    return None if figure is None else float(getattr(figure, quantity))


def _chart(models: Mapping[str, Figures], quantity: str) -> LineChart:
    """Means over our objects against the level, ours and the paper's."""
    objects = sorted({name for figures in models.values() for name, _ in figures})
    curves = []
    for model in published.LAVAL_MODELS:
        for who in ("ours", "paper"):
            known = []
            for level in published.LAVAL_LEVELS:
                cells = [_printed(model, one, level, quantity) for one in objects]
                if who == "ours":
                    cells = [_ours(models, model, one, level, quantity) for one in objects]
                value = mean(cells)
                known += [] if value is None else [(float(level), value)]
            if known:
                x, y = zip(*known, strict=True)
                curves.append(Curve(f"{who} {model}", x, y))
    label = "T, mm" if quantity == "translation" else "R, degrees"
    title = f"Laval: {quantity}, mean of our objects"
    return LineChart(f"laval_{quantity}", title, "occluded, %", label, tuple(curves))
