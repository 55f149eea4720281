"""Instances of one mesh: who stands where another one is, and who may stay there."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
import pytest
import torch

from moveit6d import Camera, Mesh, OraclePolicy, Pose, PoseTracker
from moveit6d.config import ActionMode, TrackerConfig
from moveit6d.estimation.apart import TAKEN, Instances
from moveit6d.estimation.covariance import Information
from moveit6d.estimation.results import Refined, StopReason, TrackingResult
from moveit6d.estimation.track_state import TrackState
from tests.support.configs import LOOP_ONLY, LOW_CONFIDENCE, NO_CONTOUR
from tests.support.near_sighted import NearSighted

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
GRAY = np.full((240, 320, 3), 90, np.uint8)
KNOWN = Information(torch.eye(6), torch.tensor(0.1), "look_at", 3.0)


def at(x: float, z: float = 0.7) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([x, 0.0, z], dtype=torch.float64))


def instances(mesh: Mesh, *places: float) -> Instances:
    tracks = [TrackState.begin(mesh, at(x)) for x in places]
    same = [[k for k in range(len(places)) if k != number] for number in range(len(places))]
    return Instances(tracks, same, CAMERA, TrackerConfig())


def ends(*results: tuple[float, float]) -> dict[int, Refined]:
    """Results by their places and confidences."""
    return {
        k: Refined(at(x), 3, StopReason.STOP_ACTION, confidence, 1.0)
        for k, (x, confidence) in enumerate(results)
    }


def alive(known: Instances, *results: tuple[float, float]) -> list[bool]:
    return [one.centred is not None for one in known.kept_apart(ends(*results)).values()]


def test_who_came_to_the_place_of_another_has_no_pose_but_a_reason(brick: Mesh) -> None:
    known = instances(brick, 0.0, 0.15)
    found = {
        k: dataclasses.replace(one, information=KNOWN)
        for k, one in ends((0.15, 0.95), (0.15, 0.94)).items()
    }
    first, second = known.kept_apart(found).values()
    assert first.centred is None and first.error == TAKEN and first.confidence == 0
    assert first.stopped_by is StopReason.FAILED and first.information is None
    assert second is found[1]
    assert alive(known, (0.01, 0.3), (0.15, 0.9)) == [True, True]


def test_who_was_recovered_to_the_place_of_another_goes_back(brick: Mesh) -> None:
    known, earlier = instances(brick, 0.0, 0.15), ends((0.0, 0.3), (0.15, 0.94))
    recovered = {**earlier, 0: ends((0.15, 0.95))[0]}
    assert known.kept_apart(recovered, earlier)[0] is earlier[0]


def test_one_of_low_confidence_does_not_block_another(brick: Mesh) -> None:
    assert alive(instances(brick, 0.0, 0.15), (0.15, 0.9), (0.15, 0.2)) == [True, False]


def test_of_two_that_were_there_the_one_in_doubt_goes_and_then_the_less_confident(
    brick: Mesh,
) -> None:
    known = instances(brick, 0.0, 0.001)
    assert alive(known, (0.0, 0.8), (0.0, 0.9)) == [False, True]
    known.tracks[1].miss()
    assert alive(known, (0.0, 0.8), (0.0, 0.9)) == [True, False]


def test_what_lies_together_may_lie_together(brick: Mesh) -> None:
    share = TrackerConfig().detection.same_instance * brick.sphere_diameter
    assert alive(instances(brick, 0.0, 0.2 * share), (0.0, 0.9), (0.2 * share, 0.9)) == [True] * 2
    # And may come there, though not by a leap.
    assert alive(instances(brick, 0.0, 1.1 * share), (0.0, 0.9), (0.9 * share, 0.9)) == [True] * 2
    assert (
        alive(instances(brick, 0.0, 1.1 * share), (0.0, 0.9), (0.2 * share, 0.9)).count(True) == 1
    )


def test_a_pose_stands_on_another_only_where_the_object_was_not(brick: Mesh) -> None:
    known = instances(brick, 0.0, 0.15, 0.01)
    others = {1: at(0.15), 2: at(0.01)}
    assert known.stands_on_another(0, at(0.14), others)
    assert not known.stands_on_another(0, at(0.07), others)
    assert not known.stands_on_another(0, at(0.02), others), "it lay beside that one before"
    assert known.sure(ends((0.0, LOW_CONFIDENCE), (0.1, LOW_CONFIDENCE - 0.01))).keys() == {0}


def test_other_meshes_are_not_in_the_way(brick: Mesh) -> None:
    known = instances(brick, 0.0, 0.15)
    known.same = [[], []]
    assert alive(known, (0.15, 0.9), (0.15, 0.9)) == [True, True]
    assert not known.stands_on_another(0, at(0.15), {1: at(0.15)})


@pytest.mark.parametrize("order", [(0.0, 0.15), (0.15, 0.0)])
def test_a_hidden_instance_does_not_follow_its_neighbour(
    brick: Mesh, order: Sequence[float]
) -> None:
    policy = OraclePolicy(Pose.stack([brick.inner(at(0.15))] * 2), ActionMode.ALL_AXES)
    tracker = PoseTracker(
        [brick, brick], CAMERA, [at(x) for x in order], policy=policy, config=LOOP_ONLY
    )
    hidden = order.index(0.0)
    for _ in range(3):
        results: list[TrackingResult] = tracker.update(GRAY)
        assert results[hidden].pose is None and results[hidden].error == TAKEN
        seen = results[1 - hidden].pose
        assert seen is not None
        torch.testing.assert_close(seen.matrix, at(0.15).matrix, atol=1e-3, rtol=0)
        torch.testing.assert_close(tracker.poses[hidden].matrix, at(0.0).matrix)


def test_a_hidden_instance_is_not_recovered_where_its_neighbour_is(brick: Mesh) -> None:
    place = 0.08  # as far as recovery starts lead this policy, and another instance
    for meshes, starts in (([brick], [at(0.0)]), ([brick] * 2, [at(0.0), at(place)])):
        policy = NearSighted(brick.inner(at(place)), 40.0, doubt=0.3)
        tracker = PoseTracker(meshes, CAMERA, starts, policy=policy, config=NO_CONTOUR)
        first: TrackingResult = tracker.update(GRAY)[0]
        alone = len(meshes) == 1
        assert first.pose is not None
        there = at(place if alone else 0.0)
        torch.testing.assert_close(first.pose.matrix, there.matrix, atol=1e-3, rtol=0)


def test_where_it_was_sure_does_not_count_if_another_is_there_now(brick: Mesh) -> None:
    policy = NearSighted(brick.inner(at(0.15)), 21.0, doubt=0.3)
    tracker = PoseTracker([brick] * 2, CAMERA, [at(0.0), at(0.15)], policy=policy, config=LOOP_ONLY)
    tracker.tracks[0].miss()
    tracker.tracks[0].last_confident = brick.inner(at(0.15))
    first, second = tracker.update(GRAY)
    assert first.pose is not None and first.confidence == pytest.approx(0.3)
    torch.testing.assert_close(first.pose.matrix, at(0.0).matrix)
    assert second.confidence == pytest.approx(0.95)
