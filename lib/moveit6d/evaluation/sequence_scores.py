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
from ..geometry.pose import Pose
from .metrics import ADD_LIMIT
from .protocols import is_given
from .track_files import Track, read_tracks
from .track_scores import EvaluationPoints, Score, frame_errors, score


def scored_truth(
    sequence: Sequence, rows: Mapping[int, PoseRow], count_resets: bool = False
) -> dict[int, Pose]:
    """The true poses that a track is scored against: the first, and those of the frames that count.

    The first frame's pose was given and is not scored; where the truth is not known there, the
    start stands for it. Only the sequence's keyframes count, where it has any; frames whose pose a
    protocol gave count only with `count_resets`, as their error is 0 by definition. A track that
    says of which images it is may be of the later part of the sequence: it is scored from its first
    row on.
    """
    keys, given = sequence.keyframes, {frame for frame, row in rows.items() if is_given(row)}
    begin = min(rows) if any(row.image for row in rows.values()) else 0
    first = max(begin, sequence.first)
    later = {frame: pose for frame, pose in sequence.truth.items() if frame >= first}
    return {
        frame: pose
        for frame, pose in ({first: sequence.start} | later).items()
        if frame == first
        or ((keys is None or frame in keys) and (count_resets or frame not in given))
    }


def gaps(sequence: Sequence, rows: Mapping[int, PoseRow]) -> list[str]:
    """What is to be known of a track that does not have a row for every frame with a true pose."""
    first, *frames = sorted(scored_truth(sequence, rows, count_resets=True))
    before = sum(frame < first for frame in sequence.truth)
    absent = len({*frames} - rows.keys())
    said = []
    if before:
        said.append(f"its track begins with frame {min(rows)}; the frames before are not scored")
    if absent:
        said.append(f"{absent} of {len(frames)} frames have no row in its track and count as wrong")
    return said


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
    sequences: Iterable[Sequence], path: str | Path, count_resets: bool = False
) -> dict[str, Score]:
    """The figures of the results at `path` by sequence; sequences without a result are left out.

    `path` is what `read_tracks` knows. `count_resets` counts frames whose pose was given, too.
    """
    return score_tracks(read_tracks(sequences, path), count_resets)


def score_tracks(
    tracks: Iterable[tuple[Sequence, Track]], count_resets: bool = False
) -> dict[str, Score]:
    """The figures of tracks by sequence; those with too few true poses are left out."""
    scores = {}
    for sequence, rows in tracks:
        found = score_track(sequence, rows, count_resets)
        if found is not None:
            scores[sequence.name] = found
    return scores


def confidences(tracks: Iterable[tuple[Sequence, Track]]) -> tuple[Tensor, Tensor]:
    """Confidences (N,) of all scored frames of tracks with a pose, and which (N,) are right.

    That is ADD(-S) below 10 % of the diameter.
    """
    found: list[float] = []
    right: list[bool] = []
    for sequence, rows in tracks:
        surface = EvaluationPoints.of(sequence.load_mesh(), symmetric=sequence.symmetric)
        for error in frame_errors(rows, scored_truth(sequence, rows), surface):
            row = rows.get(error.frame)
            if row is not None and row.pose is not None and row.confidence is not None:
                found.append(row.confidence)
                right.append(error.add < ADD_LIMIT * surface.diameter)
    return torch.tensor(found), torch.tensor(right)
