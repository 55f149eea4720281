"""The detector finds an object without a start, and each criterion chooses as it says."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from moveit6d.actions import pose_delta
from moveit6d.config import ActionMode
from moveit6d.errors import InputError
from moveit6d.estimation import (
    SeedDetector,
    SeedDetectorConfig,
    SelectionCriterion,
    StopReason,
    TrackingResult,
)
from moveit6d.estimation.seed_detector import Candidate, best_of, strongest
from moveit6d.estimation.seeding import Sink
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import random_rotations
from moveit6d.policies import BATCH_SIZE, OraclePolicy
from tests.support.configs import limited

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
GRAY = np.full((240, 320, 3), 90, np.uint8)
SMALL = SeedDetectorConfig(sizes=(0.3,), poses=1, sinks=1, rotations=4)


def a_sink(x: float, strength: float) -> Sink:
    return Sink(torch.tensor([x, 50.0]).double(), strength, 40.0)


def a_candidate(
    iterations: int,
    confidence: float,
    path_length: float,
    reason: StopReason = StopReason.STOP_ACTION,
) -> Candidate:
    pose = None if reason is StopReason.FAILED else Pose.identity()
    result = TrackingResult(pose, iterations, reason, confidence, 1.0)
    return Candidate(a_sink(0, 1), Pose.identity(), result, path_length)


@pytest.mark.parametrize("criterion", list(SelectionCriterion))
def test_an_oracle_is_found_without_a_start(brick: Mesh, criterion: SelectionCriterion) -> None:
    """With a policy that knows the way, seeds, sink and grid end at the truth."""
    turn = random_rotations(1, torch.Generator().manual_seed(3))[0]
    truth = Pose(turn, torch.tensor([0.06, -0.02, 0.75], dtype=torch.float64))
    many = Pose(turn.expand(BATCH_SIZE, 3, 3), truth.translation.expand(BATCH_SIZE, 3))
    policy = OraclePolicy(many, ActionMode.ALL_AXES)
    detector = SeedDetector(
        brick, CAMERA, config=replace(SMALL, criterion=criterion), policy=policy
    )
    found = detector.detect(GRAY)
    assert found.pose is not None and len(found.candidates) == 4 and len(found.fields) == 1
    diameter = torch.tensor(brick.sphere_diameter, dtype=torch.float64)
    assert pose_delta(brick.inner(found.pose), truth, diameter).abs().max() < 0.5
    centre = CAMERA.project(truth.translation)
    assert (found.places[0][0].centre - centre).norm() < 0.3 * found.places[0][0].size
    again = detector.detect(GRAY)
    assert again.pose is not None and torch.equal(again.pose.rotation, found.pose.rotation)


def test_each_criterion_has_its_own_favourite() -> None:
    quick = a_candidate(2, 0.3, 50)
    sure = a_candidate(5, 0.9, 20)
    near = a_candidate(2, 0.2, 10)
    endless = a_candidate(1, 0.8, 1, StopReason.MAX_ITERATIONS)
    lost = a_candidate(1, 1.0, float("inf"), StopReason.FAILED)
    field = [quick, endless, sure, near, lost]
    assert best_of(field, SelectionCriterion.ITERATIONS) is near  # among equals the shortest way
    assert best_of(field, SelectionCriterion.CONFIDENCE) is sure
    assert best_of([lost], SelectionCriterion.ITERATIONS) is None


def test_near_sinks_of_several_sizes_are_one_place() -> None:
    sinks = [a_sink(0, 1.0), a_sink(200, 0.5), a_sink(8, 2.0), a_sink(90, 0.1)]
    found = strongest(sinks, 2)
    assert [[sink.strength for sink in place] for place in found] == [[2.0, 1.0], [0.5]]
    assert strongest([], 3) == ()


def test_nothing_that_moves_inward_is_no_detection(brick: Mesh) -> None:
    class Away(OraclePolicy):
        def predict(self, seen, state):  # type: ignore[no-untyped-def]
            prediction = super().predict(seen, state)
            return type(prediction)(prediction.logits, -prediction.delta, prediction.confidence)

    pose = Pose(torch.eye(3).double()[None], torch.tensor([[0.0, 0.0, 0.75]]).double())
    found = SeedDetector(
        brick,
        CAMERA,
        config=replace(SMALL, loop=limited(1)),
        policy=Away(pose, ActionMode.ALL_AXES),
    ).detect(GRAY)
    assert all(
        (sink.centre - torch.tensor([159.5, 119.5])).norm() > 40
        for place in found.places
        for sink in place
    )


@pytest.mark.parametrize(
    ("options", "message"), [({"sizes": ()}, "sizes"), ({"rotations": 0}, "1 or more")]
)
def test_a_search_that_looks_nowhere_is_refused(options: dict, message: str) -> None:  # type: ignore[type-arg]
    with pytest.raises(InputError, match=message):
        SeedDetectorConfig(**options)


def test_unknown_criteria_and_wrong_images_are_refused(brick: Mesh) -> None:
    policy = OraclePolicy(Pose.identity(1))
    with pytest.raises(InputError, match="no criterion 'luck'"):
        SeedDetectorConfig(criterion="luck")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="320×240"):
        SeedDetector(brick, CAMERA, policy=policy).detect(np.zeros((10, 10, 3), np.uint8))
