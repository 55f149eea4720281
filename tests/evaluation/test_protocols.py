"""Resets come when, where and as often as each protocol's authors say."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.datasets.video import VideoFrame
from moveit6d.errors import InputError
from moveit6d.estimation import StopReason, TrackingResult
from moveit6d.evaluation.protocols import (
    LAVAL,
    NO_RESET,
    PAPER,
    RBOT,
    Protocol,
    follow_protocol,
    is_given,
)
from moveit6d.evaluation.run_tracker import TrackedFrame
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3

IMAGE = np.zeros((2, 2, 3), np.uint8)


def at(x: float, degrees: float = 0.0) -> Pose:
    turn = torch.tensor([0.0, math.radians(degrees), 0.0], dtype=torch.float64)
    return Pose(exp_so3(turn), torch.tensor([x, 0.0, 1.0], dtype=torch.float64))


class Drifter:
    """Is moved by the same amount in every frame; `seen` and `resets` list what happened to it."""

    def __init__(self, drift: float) -> None:
        self.x, self.drift = 0.0, drift
        self.updates = 0
        self.resets: list[float] = []

    def reset(self, pose: Pose) -> None:
        self.x = float(pose.translation[0])
        if self.x > 50:
            raise InputError("Start pose: outside of the image.")
        self.resets.append(self.x)

    def update(self, image: Any) -> TrackingResult:
        self.updates += 1
        self.x += self.drift
        return TrackingResult(at(self.x), 3, StopReason.STOP_ACTION, 0.9, 5.0)


class Scripted:
    """Gives these poses, one after the other, whatever it is set to."""

    def __init__(self, poses: Sequence[Pose | None]) -> None:
        self.poses = list(poses)
        self.resets = 0

    def reset(self, pose: Pose) -> None:
        self.resets += 1

    def update(self, image: Any) -> TrackingResult:
        pose = self.poses.pop(0)
        reason = StopReason.FAILED if pose is None else StopReason.STOP_ACTION
        return TrackingResult(pose, 3, reason, 0.9, 5.0, None)


def run(
    tracker: Any,
    protocol: Protocol,
    frames: int,
    truth: Callable[[int], Pose | None] = lambda k: at(0.0),
) -> list[TrackedFrame]:
    """Frames 1 … `frames`, after the start frame 0."""
    video = [VideoFrame(k, f"{k}.png", IMAGE) for k in range(1, frames + 1)]
    known = {k: pose for k in range(frames + 1) if (pose := truth(k)) is not None}
    return list(follow_protocol(tracker, video, known, protocol))


def resets(steps: Sequence[TrackedFrame]) -> list[int]:
    return [step.row.frame for step in steps if step.row.reset]


def test_without_resets_the_tracker_is_left_alone() -> None:
    tracker = Drifter(0.04)
    steps = run(tracker, NO_RESET, 40)
    assert resets(steps) == [] and tracker.resets == [] and tracker.updates == 40
    assert [step.row.frame for step in steps] == list(range(1, 41))
    assert steps[-1].row.pose is not None
    assert float(steps[-1].row.pose.translation[0]) == pytest.approx(1.6)


def test_the_paper_gives_the_truth_every_15_frames_from_the_second_frame_on() -> None:
    tracker = Drifter(0.01)
    steps = run(tracker, PAPER, 40, truth=lambda k: at(k / 1000))
    assert resets(steps) == [1, 16, 31] and tracker.resets == [0.001, 0.016, 0.031]
    assert tracker.updates == 37  # no estimate is made in a frame that is given
    for step in steps:
        row = step.row
        assert row.pose is not None and is_given(row) == row.reset
        since = (row.frame - 1) % 15
        expected = (row.frame - since) / 1000 + 0.01 * since
        assert float(row.pose.translation[0]) == pytest.approx(expected)
    assert steps[0].row.milliseconds is None and steps[0].row.stopped_by == "reset"


def test_a_reset_waits_for_a_known_truth_that_can_be_seen() -> None:
    def holes(k: int) -> Pose | None:
        return {16: None, 17: at(99.0)}.get(k, at(0.0))

    steps = run(Drifter(0.01), PAPER, 35, holes)
    assert resets(steps) == [1, 18, 31]


def test_rbot_sets_the_failed_frame_to_its_own_truth_and_keeps_the_estimate() -> None:
    tracker = Drifter(0.02)
    steps = run(tracker, RBOT, 9)
    assert resets(steps) == [3, 6, 9] and tracker.updates == 9
    assert not any(is_given(step.row) for step in steps)
    assert steps[2].row.pose is not None
    assert float(steps[2].row.pose.translation[0]) == pytest.approx(0.06)


@pytest.mark.parametrize(
    ("pose", "failed"),
    [
        (at(0.05), False),  # the limits themselves are right
        (at(0.0501), True),
        (at(0, 4.999), False),
        (at(0, 5.001), True),
        (None, True),
    ],
)
def test_rbot_fails_beyond_5_cm_or_5_degrees(pose: Pose | None, failed: bool) -> None:
    tracker = Scripted([pose])
    assert (resets(run(tracker, RBOT, 1)) == [1]) == failed and tracker.resets == int(failed)


@pytest.mark.parametrize("bad", [at(0.031), at(0, 20.1), None])
def test_laval_resets_after_the_eighth_bad_frame_in_a_row(bad: Pose | None) -> None:
    good = at(0.029, 19.5)
    seven = [bad] * 7 + [good] * 5
    assert resets(run(Scripted(seven), LAVAL, 12)) == []
    eight = Scripted([bad] * 8 + [good] * 4)
    steps = run(eight, LAVAL, 12)
    assert resets(steps) == [9] and eight.resets == 1 and is_given(steps[8].row)


def test_laval_counts_anew_after_a_reset_and_after_a_good_frame() -> None:
    bad = at(0.2)
    assert resets(run(Scripted([bad] * 30), LAVAL, 27)) == [9, 18, 27]
    broken = [bad] * 7 + [at(0)] + [bad] * 7 + [at(0)]
    assert resets(run(Scripted(broken), LAVAL, 16)) == []


def test_laval_judges_by_its_own_rotation_error() -> None:
    turn = torch.full((3,), math.radians(19.7 / math.sqrt(3)), dtype=torch.float64)
    pose = Pose(exp_so3(turn), at(0).translation)  # 19.7° about (1, 1, 1), officially 20.4°
    assert resets(run(Scripted([pose] * 9), LAVAL, 9)) == [9]


def test_frames_that_cannot_be_judged_or_read_are_followed_all_the_same() -> None:
    class Failing(Drifter):
        def reset(self, pose: Pose) -> None:
            raise InputError("Start pose: behind the camera.")

    assert resets(run(Failing(1.0), RBOT, 3)) == []
    assert resets(run(Drifter(1.0), RBOT, 3, truth=lambda k: None)) == []
    frames = [VideoFrame(k, "", None, "broken file") for k in range(1, 10)]
    truth = {k: at(0.0) for k in range(10)}
    steps = list(follow_protocol(Drifter(0), frames, truth, LAVAL))  # type: ignore[arg-type]
    assert [step.error for step in steps[:8]] == ["broken file"] * 8 and steps[8].row.reset


def test_a_reset_every_zero_frames_is_refused() -> None:
    with pytest.raises(InputError, match="reset_every is 0"):
        Protocol("mine", reset_every=0)
