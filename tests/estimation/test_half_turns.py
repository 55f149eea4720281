"""An object that was found upside down is turned, if its pictures say so again and again."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from moveit6d import Pose, PoseDetector, PoseTracker, load_policy
from moveit6d.config import DetectorConfig, LoopConfig, RecoveryConfig, TrackerConfig
from moveit6d.errors import InputError
from moveit6d.estimation import StopReason, TrackingResult
from moveit6d.estimation.detection import Detection, Evidence, FoundPose
from moveit6d.estimation.detection.steps import Steps, finish
from moveit6d.estimation.half_turns import (
    HalfTurnCheck,
    half_turned,
    is_turned_over,
    likelier_half_turn,
)
from moveit6d.estimation.results import Start
from moveit6d.frame import prepare_frame
from moveit6d.geometry.rotation import exp_so3
from moveit6d.rendering.backends import make_renderer
from tests.support.near_sighted import Numbered


def test_half_turns_are_known_by_their_objects_number(scene: Any) -> None:
    policy = Numbered(scene.mesh.inner(scene.pose(0)), 21.0)
    frame = prepare_frame(scene.image(0), scene.camera)
    start = Start(frame, scene.mesh, scene.mesh.inner(scene.pose(0)))
    tools: Any = {"policy": policy, "renderer": make_renderer(), "loop": LoopConfig()}
    likelier_half_turn(HalfTurnCheck(), start, 0.9, target=4, **tools)
    assert policy.numbers == {4}


def test_a_half_turn_keeps_the_box_in_its_place(scene: Any) -> None:
    pose = scene.mesh.inner(scene.pose(0))
    points = torch.from_numpy(scene.mesh.vertices).double()
    for turned in half_turned(scene.mesh, pose):
        angle = Pose(turned.rotation @ pose.rotation.mT, pose.translation).rotation.trace()
        assert float(angle) == pytest.approx(-1, abs=1e-6)
        middle, before = (p.transform(points).mean(0) for p in (turned, pose))
        assert float((middle - before).norm()) < 0.1 * scene.mesh.diameter


def test_evidence_adds_up_and_starts_anew_after_a_change() -> None:
    check = HalfTurnCheck(RecoveryConfig(half_turn_evidence=0.5))
    assert check.better(0.99, [0.98, 0.2, 0.992]) is None
    assert check.better(0.99, [0.9999999, 0.2, 0.992]) == 0
    assert check.better(0.99, [0.98, 0.2, 0.992]) is None
    assert check.better(0.99, [0.98, 0.2, 0.994]) == 2


def test_evidence_of_a_pose_that_was_left_does_not_count() -> None:
    check = HalfTurnCheck(RecoveryConfig(half_turn_evidence=0.5))
    assert check.better(0.99, [0.992, 0.2, 0.3]) is None
    check.restart()
    assert check.better(0.99, [0.993, 0.2, 0.3]) is None
    assert check.better(0.99, [0.993, 0.2, 0.3]) == 0


def test_fewer_half_turns_where_some_are_symmetries() -> None:
    check = HalfTurnCheck(RecoveryConfig(half_turn_evidence=0.5))
    assert check.better(0.99, []) is None
    assert check.better(0.5, [0.9]) == 0


def test_turned_over_is_more_than_a_quarter_turn() -> None:
    still = torch.zeros(3, dtype=torch.float64)
    for degrees in (0, 89, 91, 180):
        turn = torch.deg2rad(torch.tensor([0.0, degrees, 0.0], dtype=torch.float64))
        one, other = Pose(exp_so3(turn), still), Pose(exp_so3(still), still)
        assert is_turned_over(one, other) is (degrees > 90)


def test_never_if_it_is_switched_off() -> None:
    check = HalfTurnCheck(RecoveryConfig(half_turn_frames=0))
    assert not any(check.is_due() for _ in range(20))
    with pytest.raises(InputError, match="half_turn_interval must be 1 or more"):
        RecoveryConfig(half_turn_interval=0)


class Finder:
    """A detector that finds the object at a pose."""

    config = DetectorConfig()

    def __init__(self, pose: Pose) -> None:
        self.pose = pose

    def steps(self, frame: Any, region: Any = None, given: Any = (), most: int = 0) -> Steps:
        result = TrackingResult(self.pose, 1, StopReason.MAX_ITERATIONS, 0.9, 1.0)
        return Detection((FoundPose(result, Evidence(0.9, 0.9)),))
        yield


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_who_was_found_turned_is_followed_as_it_is(scene: Any, axis: int) -> None:
    turned = half_turned(scene.mesh, scene.mesh.inner(scene.pose(0)))[axis]
    errors = {}
    for frames in (0, 4):
        config = TrackerConfig(recovery=RecoveryConfig(half_turn_frames=frames))
        tracker = PoseTracker(scene.mesh, scene.camera, policy=load_policy(), config=config)
        tracker.supervisors[0].detector = Finder(scene.mesh.outer(turned))  # type: ignore[assignment]
        poses = [tracker.update(scene.image(k)).pose for k in range(3)]
        errors[frames] = [
            180.0 if pose is None else _degrees(pose, scene.pose(k)) for k, pose in enumerate(poses)
        ]
    assert errors[4][-1] < 3
    assert errors[0][-1] > 20


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_search_tries_them_too(scene: Any, axis: int) -> None:
    turned = half_turned(scene.mesh, scene.mesh.inner(scene.pose(0)))[axis]
    found = {}
    for count in (0, 1):
        config = TrackerConfig(detection=DetectorConfig(half_turns=count))
        detector = PoseDetector(scene.mesh, scene.camera, policy=load_policy(), config=config)
        steps = detector.steps(scene.image(0), given=[scene.mesh.outer(turned)], search=False)
        best = finish(steps).best
        assert best is not None
        found[count] = _degrees(best.pose, scene.pose(0))
    assert found[1] < 3 and found[0] > 20


def _degrees(one: Pose, other: Pose) -> float:
    trace = (one.rotation @ other.rotation.mT).trace()
    return float(torch.rad2deg(torch.arccos(((trace - 1) / 2).clamp(-1, 1))))
