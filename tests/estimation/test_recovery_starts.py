"""Followed objects of low confidence are tried from recovery poses, each under its own number."""

from __future__ import annotations

import numpy as np
import torch

from moveit6d.config import ActionMode
from moveit6d.estimation.apart import Instances
from moveit6d.estimation.recovery_starts import recovered
from moveit6d.estimation.results import Refined, StopReason
from moveit6d.estimation.track_state import TrackState
from moveit6d.frame import prepare_frame
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from tests.support.configs import NO_CONTOUR
from tests.support.near_sighted import Numbered

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
GRAY = np.full((240, 320, 3), 90, np.uint8)


def at(x: float) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([x, 0.0, 0.7], dtype=torch.float64))


def of(brick: Mesh, policy: Numbered, confidence: float) -> tuple[Refined, Refined]:
    """A result of the last of three objects, and what takes its place."""
    tracks = [TrackState.begin(brick, brick.inner(at(0.0)), NO_CONTOUR) for _ in range(3)]
    instances = Instances(tracks, [[], [], []], CAMERA, NO_CONTOUR)
    result = Refined(tracks[2].centred, 1, StopReason.STOP_ACTION, confidence, 1.0)
    found = recovered(
        prepare_frame(GRAY, CAMERA), {2: result}, instances,
        policy=policy, renderer=make_renderer(), config=NO_CONTOUR,
    )  # fmt: skip
    return result, found[2]


def test_a_low_confidence_is_tried_from_other_starts_under_the_objects_number(brick: Mesh) -> None:
    policy = Numbered(brick.inner(at(0.02)), 30.0)
    result, found = of(brick, policy, 0.1)
    assert policy.numbers == {2} and found.confidence > 0.9 > result.confidence
    assert found.centred is not None
    torch.testing.assert_close(found.centred.matrix, policy.truth.matrix)


def test_a_confident_result_and_the_papers_policy_are_left_alone(brick: Mesh) -> None:
    for policy, confidence in (
        (Numbered(brick.inner(at(0.02)), 30.0), 0.9),
        (Numbered(brick.inner(at(0.02)), 30.0, mode=ActionMode.SINGLE), 0.1),
    ):
        result, found = of(brick, policy, confidence)
        assert found is result and not policy.numbers
