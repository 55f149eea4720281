"""Tracks under the paper's protocol: what counts, and that nothing is run twice or mixed."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from moveit6d.config import ActionMode
from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.sequences import Sequence, read_sequences
from moveit6d.errors import InputError
from moveit6d.estimation import PoseTracker
from moveit6d.evaluation.protocols import GIVEN, NO_RESET, PAPER, Protocol
from moveit6d.evaluation.reproduce.tracks import TrackSettings, run_tracks, scored
from moveit6d.evaluation.run_tracker import TrackedFrame
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from tests.support.configs import NO_CONTOUR


@pytest.fixture
def video(make_sequence: Callable[..., Any]) -> Sequence:
    """The brick standing still for five frames."""
    return read_sequences(make_sequence("easy_00", frames=5, still=True).folder)[0]


def as_it_is(video: Sequence, steps: Iterator[TrackedFrame]) -> Iterator[TrackedFrame]:
    return steps


class Counting:
    """Makes trackers that know the truth, and counts them."""

    def __init__(self) -> None:
        self.made = 0

    def __call__(self, mesh: Any, camera: Any, start: Any) -> PoseTracker:
        self.made += 1
        policy = OraclePolicy(Pose.stack([mesh.inner(start)]), ActionMode.ALL_AXES)
        return PoseTracker(mesh, camera, start, policy=policy, config=NO_CONTOUR)


def settings(
    make: Counting, folder: Path | None, protocol: Protocol = PAPER, **facts: Any
) -> TrackSettings:
    return TrackSettings(make, lambda _: protocol, {"weights": "oracle", **facts}, folder)


def test_given_frames_do_not_count(video: Sequence) -> None:
    (track,) = run_tracks([video], settings(Counting(), None), as_it_is)
    assert track.frames == (2, 3, 4)  # 0 is the start, 1 is given as the first of fifteen
    torch.testing.assert_close(track.estimate.translation, track.truth.translation)
    # The first frame is looked at as a whole, then closely; the others closely at once.
    assert track.iterations == (2, 1, 1) and min(track.milliseconds) > 0 and track.held == 0
    (free,) = run_tracks([video], settings(Counting(), None, NO_RESET), as_it_is)
    assert free.frames == (1, 2, 3, 4)


def test_only_keyframes_count_where_there_are_such(video: Sequence) -> None:
    keyed = replace(video, keyframes=frozenset({3}))
    (track,) = run_tracks([keyed], settings(Counting(), None), as_it_is)
    assert track.frames == (3,)
    none = replace(video, keyframes=frozenset())
    assert list(run_tracks([none], settings(Counting(), None), as_it_is)) == []


def test_a_frame_without_a_pose_keeps_the_last_one(video: Sequence) -> None:
    moved = Pose(video.start.rotation, video.start.translation + 0.01)
    rows = {
        1: PoseRow(1, pose=video.start, stopped_by=GIVEN, reset=True),
        2: PoseRow(2, pose=moved, iterations=3),
        3: PoseRow(3),
    }
    track = scored(video, rows)
    assert track is not None and track.frames == (2, 3) and track.held == 1
    torch.testing.assert_close(track.estimate.translation[1], moved.translation)


def test_tracks_are_kept_and_used_again(video: Sequence, tmp_path: Path) -> None:
    make = Counting()
    first = list(run_tracks([video], settings(make, tmp_path / "t"), as_it_is))
    again = list(run_tracks([video], settings(make, tmp_path / "t"), as_it_is))
    assert make.made == 1
    torch.testing.assert_close(first[0].estimate.matrix, again[0].estimate.matrix)
    assert first[0].frames == again[0].frames and first[0].iterations == again[0].iterations


def test_tracks_of_another_setting_are_refused(video: Sequence, tmp_path: Path) -> None:
    list(run_tracks([video], settings(Counting(), tmp_path / "t"), as_it_is))
    with pytest.raises(InputError, match="another setting"):
        list(run_tracks([video], settings(Counting(), tmp_path / "t", mode="single"), as_it_is))


def test_a_few_frames_are_enough_to_try(video: Sequence) -> None:
    short = replace(settings(Counting(), None), frames=2)
    (track,) = run_tracks([video], short, as_it_is)
    assert track.frames == (2,)
