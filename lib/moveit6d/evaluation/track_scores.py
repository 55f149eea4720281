"""Scores the track of one object through one sequence against its true poses.

Never tracks. The protocol and every figure are those of the project's benchmark sequences: the
first frame (its pose is given) is not scored, a frame without a pose is wrong, ADD is cut at one
diameter before it is averaged.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import Tensor

from ..datasets.pose_files import PoseRow, by_frame, read_poses
from ..errors import InputError
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from . import metrics
from .tables import markdown, percent

SURFACE_POINTS = 2000
LEVELS = ("easy", "occ", "fast", "hard")


@dataclass(frozen=True)
class EvaluationPoints:
    """What scoring needs of an object: points (N, 3) on its surface and its diameter, metres.

    For an object that is declared symmetric ADD is ADD-S throughout.
    """

    points: Tensor
    diameter: float
    symmetric: bool = False

    @staticmethod
    def of(mesh: Mesh, count: int = SURFACE_POINTS, symmetric: bool = False) -> EvaluationPoints:
        """Points drawn by area with a fixed seed, in the file's frame.

        The very points of the benchmark's published figures, so that its tables come out exactly.
        """
        random = np.random.default_rng(0)
        corners = mesh.vertices.astype(np.float64)[mesh.faces] + mesh.center  # (F, 3, 3)
        edges = corners[:, 1:] - corners[:, :1]
        area = np.linalg.norm(np.cross(edges[:, 0], edges[:, 1]), axis=1)
        chosen = random.choice(len(corners), count, p=area / area.sum())
        a, b = np.sqrt(random.random(count)), random.random(count)
        weights = np.stack([1 - a, a * (1 - b), a * b], 1)
        points = (corners[chosen] * weights[..., None]).sum(1)
        return EvaluationPoints(torch.from_numpy(points), mesh.diameter, symmetric)


@dataclass(frozen=True)
class FrameError:
    """One frame's errors: ADD and origin in metres, rotation in degrees; no pose: inf and 180."""

    frame: int
    add: float
    translation: float
    rotation: float


@dataclass(frozen=True)
class Score:
    """Figures of one sequence. Shares are of 1, lengths in metres.

    `until_lost` counts scored frames from the start, frames + 1 for a track that is never lost,
    and `lost_at` is the number of the frame at which it is lost, None if it never is;
    `milliseconds` and `iterations` are the median frame's, None if nobody counted.
    """

    frames: int
    below_10: float
    below_5: float
    mean_add: float
    median_add: float
    until_lost: int
    within_5cm_5deg: float
    resets: int
    milliseconds: float | None
    missing: int
    iterations: float | None = None
    lost_at: int | None = None

    @property
    def never_lost(self) -> bool:
        """Whether the track holds to the end."""
        return self.until_lost > self.frames


def frame_errors(
    found: Mapping[int, PoseRow], truth: Mapping[int, Pose], surface: EvaluationPoints
) -> list[FrameError]:
    """Errors of every frame whose true pose is known, without the first."""
    errors = []
    for frame in sorted(truth)[1:]:
        row = found.get(frame)
        if row is None or row.pose is None:
            errors.append(FrameError(frame, float("inf"), float("inf"), 180.0))
            continue
        estimate, true = row.pose, truth[frame]
        errors.append(
            FrameError(
                frame,
                float(metrics.add_s(estimate, true, surface.points, surface.symmetric)),
                float(metrics.translation_error(estimate, true)),
                float(metrics.rotation_error(estimate, true)),
            )
        )
    return errors


def score(
    found: Mapping[int, PoseRow], truth: Mapping[int, Pose], surface: EvaluationPoints
) -> Score:
    """The figures of a track, rows by frame, against the true poses by frame."""
    errors = frame_errors(found, truth, surface)
    if not errors:
        raise InputError("scoring needs true poses of at least two frames.")
    add = torch.tensor([error.add for error in errors], dtype=torch.float64)
    near = [error.translation < 0.05 and error.rotation < 5 for error in errors]
    rows = [found[error.frame] for error in errors if error.frame in found]
    times = _known(row.milliseconds for row in rows)
    iterations = _known(row.iterations for row in rows)
    cut = add.clamp_max(surface.diameter)
    limit = metrics.ADD_LIMIT * surface.diameter
    until_lost = metrics.frames_until_lost(add, limit)
    return Score(
        frames=len(errors),
        below_10=metrics.accuracy(add, limit),
        below_5=metrics.accuracy(add, limit / 2),
        mean_add=float(cut.mean()),
        median_add=float(np.median(cut.numpy())),
        until_lost=until_lost,
        within_5cm_5deg=float(np.mean(near)),
        resets=sum(row.reset for row in rows),
        milliseconds=float(np.median(times)) if times else None,
        missing=int(torch.isinf(add).sum()),
        iterations=float(np.median(iterations)) if iterations else None,
        lost_at=errors[until_lost - 1].frame if until_lost <= len(errors) else None,
    )


def read_track(path: str | Path, mesh: Callable[[], Mesh] | None = None) -> dict[int, PoseRow]:
    """A track's rows by frame: a poses.csv of `moveit6d track` or a benchmark result.

    `mesh` loads the object's mesh, which is needed where its file's origin is far from it.
    """
    center = (0.0, 0.0, 0.0) if mesh is None else lambda _: mesh().center
    return by_frame(read_poses(path, center=center), str(path))


def tracking_table(
    scores: Mapping[str, Score], levels: Mapping[str, str], per_sequence: bool = False
) -> str:
    """Markdown table of sequences' scores by level, and of all together.

    `levels` gives each sequence's level. Figures are means over sequences, but for the median ADD
    and the iterations, which are the median of the sequences' medians.
    """
    groups = _groups(scores, levels)
    columns = _Columns.of(scores.values())
    rows = []
    for level, members in groups.items():
        rows.append([level, *columns.cells(list(members.values()))])
        if per_sequence and level != "all" and list(members) != [level]:
            rows += [[f"  {name}", *columns.cells([one])] for name, one in members.items()]
    return markdown(["level", *columns.head], rows)


def comparison_table(trackers: Mapping[str, Mapping[str, Score]], levels: Mapping[str, str]) -> str:
    """Markdown table of several trackers, level by level, in the order given."""
    columns = _Columns.of(one for scores in trackers.values() for one in scores.values())
    groups = {name: _groups(scores, levels) for name, scores in trackers.items()}
    order = dict.fromkeys(level for found in groups.values() for level in found)
    rows = []
    for level in sorted(order, key=_rank):
        for name, found in groups.items():
            if level in found:
                rows.append([level, name, *columns.cells(list(found[level].values()))])
    return markdown(["level", "tracker", *columns.head], rows)


def _known(values: Iterable[float | None]) -> list[float]:
    return [value for value in values if value is not None]


def _groups(scores: Mapping[str, Score], levels: Mapping[str, str]) -> dict[str, dict[str, Score]]:
    """Scores by name within each level, levels in their order; `all` if there are several."""
    order = sorted({levels[name] for name in scores}, key=_rank)
    groups: dict[str, dict[str, Score]] = {
        level: {name: scores[name] for name in sorted(scores) if levels[name] == level}
        for level in order
    }
    return {**groups, "all": dict(scores)} if len(order) > 1 else groups


def _rank(level: str) -> tuple[int, str]:
    if level == "all":
        return len(LEVELS) + 1, level
    return LEVELS.index(level) if level in LEVELS else len(LEVELS), level


@dataclass(frozen=True)
class _Columns:
    """The columns of a table: those of resets and iterations are there if a score has any."""

    resets: bool
    iterations: bool

    @staticmethod
    def of(scores: Iterable[Score]) -> _Columns:
        known = list(scores)
        return _Columns(
            any(score.resets for score in known),
            any(score.iterations is not None for score in known),
        )

    @property
    def head(self) -> list[str]:
        head = [
            "sequences",
            "ADD<10%d",
            "ADD<5%d",
            "mean ADD mm",
            "median ADD mm",
            "frames until lost",
            "never lost",
            "5cm/5deg",
        ]
        return [*head, *["resets"] * self.resets, *["iterations"] * self.iterations, "ms/frame"]

    def cells(self, scores: Sequence[Score]) -> list[str]:
        times = _known(score.milliseconds for score in scores)
        iterations = _known(score.iterations for score in scores)
        cells = [
            str(len(scores)),
            percent(float(np.mean([score.below_10 for score in scores]))),
            percent(float(np.mean([score.below_5 for score in scores]))),
            f"{1000 * float(np.mean([score.mean_add for score in scores])):.1f}",
            f"{1000 * float(np.median([score.median_add for score in scores])):.1f}",
            f"{float(np.mean([score.until_lost for score in scores])):.0f}",
            f"{sum(score.never_lost for score in scores)}/{len(scores)}",
            percent(float(np.mean([score.within_5cm_5deg for score in scores]))),
        ]
        cells += [str(sum(score.resets for score in scores))] * self.resets
        cells += [f"{np.median(iterations):g}" if iterations else "-"] * self.iterations
        return [*cells, f"{np.mean(times):.1f}" if times else "-"]
