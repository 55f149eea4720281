"""Runs a tracker through whole sequences and compares it with others' results.

Never shows the tracker a true pose but that of the first frame and those that a protocol of resets
gives it, and gives every sequence a fresh tracker.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..datasets.pose_files import RESULT_COLUMNS, PoseRow, PoseWriter
from ..datasets.sequences import Sequence
from ..datasets.video import VideoFrame
from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from .protocols import NO_RESET, Protocol, follow_protocol, is_given
from .run_tracker import TrackedFrame, calibrating
from .track_scores import EvaluationPoints, Score, read_track, score

if TYPE_CHECKING:
    from ..estimation import PoseTracker, TrackingResult

MakeTracker = Callable[[Mesh, Camera, Pose], "PoseTracker[TrackingResult]"]
# Of our own tracks: what every result has, and what a report of it needs.
OWN_COLUMNS = (*RESULT_COLUMNS, "steps", "stopped_by", "confidence", "reset")


def run_sequence(
    sequence: Sequence,
    make_tracker: MakeTracker,
    protocol: Protocol = NO_RESET,
    calibrate: bool = True,
) -> Iterator[TrackedFrame]:
    """Track one sequence from its start pose: one step for each frame after the first.

    The first frame's pose is given and exact: the tracker may learn the object's colours from that
    frame, and does not follow it.
    """
    tracker = make_tracker(sequence.load_mesh(), sequence.camera, sequence.start)
    frames: Iterable[VideoFrame] = (f for f in sequence.open() if f.index >= sequence.first)
    if calibrate:
        frames = calibrating(tracker, frames)
    later = (frame for frame in frames if frame.index > sequence.first)
    yield from follow_protocol(tracker, later, sequence.truth, protocol)


def gather(
    sequence: Sequence, steps: Iterable[TrackedFrame], path: Path | None
) -> dict[int, PoseRow]:
    """Rows by frame; with a path also written there as they come, in the benchmark's format.

    The first row is the given start, without a time.
    """
    rows = {sequence.first: PoseRow(frame=sequence.first, pose=sequence.start)}
    with nullcontext() if path is None else PoseWriter(path, OWN_COLUMNS) as table:
        if table is not None:
            table.write(rows[sequence.first])
        for step in steps:
            rows[step.row.frame] = step.row
            if table is not None:
                table.write(step.row)
    return rows


def scored_truth(
    sequence: Sequence, rows: Mapping[int, PoseRow], count_resets: bool = False
) -> dict[int, Pose]:
    """The true poses that a track is scored against: the first, and those of the frames that count.

    Only the sequence's keyframes count, where it has any; frames whose pose a protocol gave count
    only with `count_resets`, as their error is 0 by definition.
    """
    keys, given = sequence.keyframes, {frame for frame, row in rows.items() if is_given(row)}
    first = min(sequence.truth)
    return {
        frame: pose
        for frame, pose in sequence.truth.items()
        if frame == first
        or ((keys is None or frame in keys) and (count_resets or frame not in given))
    }


def score_track(
    sequence: Sequence, rows: dict[int, PoseRow], count_resets: bool = False
) -> Score | None:
    """The figures of one track; None where fewer than two true poses count (`scored_truth`)."""
    truth = scored_truth(sequence, rows, count_resets)
    if len(truth) < 2:
        return None
    surface = EvaluationPoints.of(sequence.load_mesh(), symmetric=sequence.symmetric)
    # Resets count wherever they were, in frames that are not scored, too.
    return replace(score(rows, truth, surface), resets=sum(row.reset for row in rows.values()))


def score_results(
    sequences: Iterable[Sequence], path: Path, count_resets: bool = False
) -> dict[str, Score]:
    """The figures of the results at `path` by sequence; sequences without a result are left out.

    `path` is a folder of <sequence>.csv or <sequence>/poses.csv or, for one sequence, one file.
    `count_resets` counts frames whose pose was given, too.
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
        found = score_track(sequence, read_track(file), count_resets) if file is not None else None
        if found is not None:
            scores[name] = found
    return scores
