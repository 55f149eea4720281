"""What a detector answers: which pose counts, and whether there is one."""

import math

import pytest
import torch

from moveit6d.config import VerificationConfig
from moveit6d.estimation import TrackingResult
from moveit6d.estimation.detection import Detection, Evidence, FoundPose
from moveit6d.estimation.results import StopReason
from moveit6d.geometry.pose import Pose

POSE = Pose(torch.eye(3, dtype=torch.float64), torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64))


def found(probability: float) -> FoundPose:
    return FoundPose(TrackingResult(POSE, 1, StopReason.MAX_ITERATIONS, probability, 1.0))


def test_nothing_looked_at_is_no_pose() -> None:
    nothing = Detection(())
    assert not nothing.found and nothing.pose is None and nothing.best is None
    assert nothing.probability == 0.0


def test_a_rejected_pose_is_the_best_one_but_not_found() -> None:
    detection = Detection((), rejected=(found(0.1), found(0.3)))
    assert not detection.found and detection.pose is None
    assert detection.best is detection.rejected[1] and detection.probability == 0.3


def test_the_pose_is_that_of_the_first_instance() -> None:
    detection = Detection((found(0.9), found(0.6)), rejected=(found(0.2),))
    assert detection.found and detection.pose is POSE and detection.probability == 0.9


def test_what_is_known_to_be_there_is_more_probable() -> None:
    config, evidence = VerificationConfig(present=1.0), Evidence(0.4, 0.5)
    result = found(evidence.probability(config)).result
    known = FoundPose(result, evidence).known_present(config)
    odds = [one / (1 - one) for one in (result.confidence, known.probability)]
    assert odds[1] / odds[0] == pytest.approx(math.e)
    assert known.pose is result.pose and found(0.3).known_present(config).probability == 0.3
