"""Runs a tracker through whole sequences without reset and compares it with others' results.

Never shows the tracker a true pose but that of the first frame, and gives every sequence a fresh
tracker.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import nullcontext
from pathlib import Path
from typing import TYPE_CHECKING

from ..datasets.files import RESULT_COLUMNS, PoseRow, PoseWriter
from ..datasets.sequences import Sequence
from ..datasets.video import Frame, open_frames
from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from .rollout import Step, follow
from .tracking import Score, Surface, read_track, score

if TYPE_CHECKING:
    from ..estimation import PoseTracker

MakeTracker = Callable[[Mesh, Camera, Pose], "PoseTracker"]


def run_sequence(sequence: Sequence, make_tracker: MakeTracker) -> Iterator[Step]:
    """Track one sequence from its start pose: one step for each frame after the first.

    The first frame's pose is given and exact, so that the tracker never sees that frame.
    """
    mesh = Mesh.load(sequence.mesh, "m")
    tracker = make_tracker(mesh, sequence.camera, sequence.start)
    yield from follow(tracker, _after(sequence, open_frames(sequence.frames)))


def gather(sequence: Sequence, steps: Iterable[Step], path: Path | None) -> dict[int, PoseRow]:
    """Rows by frame; with a path also written there as they come, in the benchmark's format.

    The first row is the given start, without a time.
    """
    rows = {sequence.first: PoseRow(frame=sequence.first, pose=sequence.start)}
    with nullcontext() if path is None else PoseWriter(path, RESULT_COLUMNS) as table:
        if table is not None:
            table.write(rows[sequence.first])
        for step in steps:
            rows[step.row.frame] = step.row
            if table is not None:
                table.write(step.row)
    return rows


def score_track(sequence: Sequence, rows: dict[int, PoseRow]) -> Score | None:
    """The figures of one track; None for a sequence with fewer than two true poses."""
    if len(sequence.truth) < 2:
        return None
    return score(rows, sequence.truth, Surface.of(Mesh.load(sequence.mesh, "m")))


def score_results(sequences: Iterable[Sequence], path: Path) -> dict[str, Score]:
    """The figures of the results at `path` by sequence; sequences without a result are left out.

    `path` is a folder of <sequence>.csv or <sequence>/poses.csv or, for one sequence, one file.
    """
    listed = list(sequences)
    if not path.exists():
        raise InputError(f"{path} does not exist; it should hold results to score.")
    if path.is_file() and len(listed) > 1:
        raise InputError(f"{path} is one track, but there are {len(listed)} sequences.")
    scores = {}
    for sequence in listed:
        name = sequence.name
        places = [path] if path.is_file() else [path / f"{name}.csv", path / name / "poses.csv"]
        file = next((place for place in places if place.exists()), None)
        found = score_track(sequence, read_track(file)) if file is not None else None
        if found is not None:
            scores[name] = found
    return scores


def _after(sequence: Sequence, frames: Iterable[Frame]) -> Iterator[Frame]:
    return (frame for frame in frames if frame.index > sequence.first)
