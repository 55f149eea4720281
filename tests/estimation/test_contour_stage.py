"""A refined contour: another pose, everything else as it was."""

from dataclasses import fields

import pytest
import torch

from moveit6d.actions import PoseAction, pose_delta
from moveit6d.config import ActionMode, ContourConfig
from moveit6d.estimation import PoseEstimator, StopReason, Target
from moveit6d.estimation.contour_stage import refine_result
from moveit6d.estimation.results import Refined, starts_of
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from moveit6d.rendering import make_renderer
from tests.support import pictures
from tests.support.configs import ALWAYS_CONTOUR, NO_CONTOUR

TRUTH = Pose(torch.eye(3).double(), torch.tensor([0.02, -0.01, 0.5], dtype=torch.float64))


def off(pose: Pose | None, mesh: Mesh) -> float:
    assert pose is not None
    size = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    return float(pose_delta(TRUTH, mesh.inner(pose), size).norm())


@pytest.fixture
def near(brick: Mesh) -> Target:
    """The brick's picture, with a pose that is two units off in place and in size."""
    size = torch.tensor(brick.sphere_diameter, dtype=torch.float64)
    wrong = PoseAction.from_delta(torch.tensor([2.0, 0, 2.0, 0, 0, 0])).apply_centred(TRUTH, size)
    image = pictures.picture(brick, TRUTH).permute(1, 2, 0).numpy()
    return Target(image, pictures.CAMERA, brick, brick.outer(wrong))


def test_only_pose_and_time_change(near: Target) -> None:
    (start,) = starts_of([near])
    given = Refined(start.centred, 3, StopReason.STOP_ACTION, 0.7, 5.0)
    found, histograms = refine_result(
        start.frame, start.mesh, given, make_renderer(), ContourConfig()
    )
    assert found.centred is not None
    assert off(near.mesh.outer(found.centred), near.mesh) < 0.8 * off(near.pose, near.mesh)
    assert found.milliseconds > 5.0 and histograms is not None
    assert found.contour_agreement is not None and found.contour_agreement > 0.5
    changed = {"centred", "milliseconds", "contour_agreement"}
    for field in fields(given):
        if field.name not in changed:
            assert getattr(found, field.name) == getattr(given, field.name)


@pytest.mark.parametrize(("confidence", "moves"), [(0.94, True), (0.95, False)])
def test_a_pose_of_which_the_network_is_sure_stays(
    near: Target, confidence: float, moves: bool
) -> None:
    (start,) = starts_of([near])
    given = Refined(start.centred, 3, StopReason.STOP_ACTION, confidence, 5.0)
    found, histograms = refine_result(
        start.frame, start.mesh, given, make_renderer(), ContourConfig()
    )
    assert found.centred is not None and start.centred is not None
    assert torch.equal(found.centred.translation, start.centred.translation) != moves
    assert histograms is not None and found.contour_agreement is not None


def test_a_failed_result_stays(near: Target) -> None:
    (start,) = starts_of([near])
    failed = Refined(None, 1, StopReason.FAILED, 0.0, 5.0, "lost")
    found = refine_result(start.frame, start.mesh, failed, make_renderer(), ContourConfig())
    assert found == (failed, None)


def test_an_estimator_polishes_unless_it_is_told_not_to(near: Target) -> None:
    policy = OraclePolicy(Pose.stack([near.mesh.inner(near.pose)]), ActionMode.ALL_AXES)
    refined, plain = (
        PoseEstimator(near.mesh, near.camera, policy=policy, config=config)
        .refine(near.image, near.pose)
        .pose
        for config in (ALWAYS_CONTOUR, NO_CONTOUR)
    )
    assert off(plain, near.mesh) == pytest.approx(8**0.5, abs=0.1)
    assert off(refined, near.mesh) < 0.8 * off(plain, near.mesh)
