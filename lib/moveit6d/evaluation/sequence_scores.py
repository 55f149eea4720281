"""Scores whole sequences: which frames of a track count, and the figures of results in files.

Never tracks.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path

import torch
from torch import Tensor

from ..datasets.pose_files import PoseRow
from ..datasets.sequences import Sequence
from ..errors import InputError
from ..geometry.pose import Pose
from .metrics import ADD_LIMIT
from .protocols import is_given
from .track_scores import EvaluationPoints, Score, frame_errors, read_track, score


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
        file = _track_of(path, sequence.name)
        if file is None:
            continue
        found = score_track(sequence, read_track(file, sequence.load_mesh), count_resets)
        if found is not None:
            scores[sequence.name] = found
    return scores


def confidences(sequences: Iterable[Sequence], path: Path) -> tuple[Tensor, Tensor]:
    """Confidences (N,) of all scored frames with a pose of the results at `path`, and which (N,)
    are right: ADD(-S) below 10 % of the diameter.
    """
    found: list[float] = []
    right: list[bool] = []
    for sequence in sequences:
        file = _track_of(path, sequence.name)
        if file is None:
            continue
        rows = read_track(file, sequence.load_mesh)
        surface = EvaluationPoints.of(sequence.load_mesh(), symmetric=sequence.symmetric)
        for error in frame_errors(rows, scored_truth(sequence, rows), surface):
            row = rows.get(error.frame)
            if row is not None and row.pose is not None and row.confidence is not None:
                found.append(row.confidence)
                right.append(error.add < ADD_LIMIT * surface.diameter)
    return torch.tensor(found), torch.tensor(right)


def _track_of(path: Path, name: str) -> Path | None:
    """The file of a sequence's track among results; None if there is none."""
    places = [path] if path.is_file() else [path / f"{name}.csv", path / name / "poses.csv"]
    return next((place for place in places if place.exists()), None)
