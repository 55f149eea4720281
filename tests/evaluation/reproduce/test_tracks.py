"""Which frames of a track count in the paper's tables."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch

from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.sequences import Sequence, read_sequences
from moveit6d.evaluation.protocols import GIVEN
from moveit6d.evaluation.reproduce.tracks import scored
from moveit6d.geometry.pose import Pose


@pytest.fixture
def video(make_sequence: Callable[..., Any]) -> Sequence:
    """The brick standing still for five frames."""
    return read_sequences(make_sequence("easy_00", frames=5, still=True).folder)[0]


def rows_of(video: Sequence) -> dict[int, PoseRow]:
    """The start, a given frame, and three that were tracked."""
    start = {0: PoseRow(0, pose=video.start), 1: PoseRow(1, pose=video.start, stopped_by=GIVEN,
             reset=True)}  # fmt: skip
    return start | {k: PoseRow(k, pose=video.start, iterations=k, milliseconds=9.0)
                    for k in (2, 3, 4)}  # fmt: skip


def test_the_start_and_given_frames_do_not_count(video: Sequence) -> None:
    track = scored(video, rows_of(video))
    assert track is not None and track.frames == (2, 3, 4)
    assert track.iterations == (2, 3, 4) and track.milliseconds == (9.0,) * 3
    torch.testing.assert_close(track.estimate.translation, track.truth.translation)


def test_only_keyframes_count_where_there_are_such(video: Sequence) -> None:
    track = scored(replace(video, keyframes=frozenset({1, 3})), rows_of(video))
    assert track is not None and track.frames == (3,)
    assert scored(replace(video, keyframes=frozenset()), rows_of(video)) is None


def test_a_frame_without_a_pose_keeps_the_last_one(video: Sequence) -> None:
    moved = Pose(video.start.rotation, video.start.translation + 0.01)
    rows = {2: PoseRow(2, pose=moved, iterations=3), 3: PoseRow(3)}
    track = scored(video, rows)
    assert track is not None and track.frames == (2, 3)
    assert track.iterations == (3, None) and track.milliseconds == (None, None)
    torch.testing.assert_close(track.estimate.translation[1], moved.translation)
