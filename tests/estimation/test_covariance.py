"""The covariance of a pose: its units, its axes, and that it is there."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch

from moveit6d import Mesh, OraclePolicy, Pose, PoseAction, load_policy
from moveit6d.config import LoopConfig
from moveit6d.errors import InputError
from moveit6d.estimation.covariance import Information, pose_covariance, update_jacobian
from moveit6d.estimation.refine import refine_batch
from moveit6d.estimation.results import Refined, StopReason, Target
from moveit6d.geometry.crop import Crop
from moveit6d.geometry.rotation import exp_so3, log_so3
from moveit6d.networks.least_squares import LONGEST
from moveit6d.rendering.backends import make_renderer
from moveit6d.synthesis.sequences.sequence import Scene

CORNERS = [[0.3, 0, 0], [0.4, 0, 0.2], [0.3, 0.1, 0], [0.3, 0, 0.1]]  # far from the file's origin
FACES = [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]


@pytest.fixture
def corner() -> Mesh:
    return Mesh.from_arrays("corner", CORNERS, FACES)


@pytest.fixture
def aside(corner: Mesh) -> Pose:
    """A centred pose away from the middle of the image."""
    return corner.inner(Pose.from_rvec([0.3, 0.4, -0.2], [0.1, -0.2, 0.9]).to(torch.float64))


@pytest.mark.parametrize("crop", ["look_at", "axis_parallel"])
def test_slopes_are_those_of_pose_action(corner: Mesh, aside: Pose, crop: Crop) -> None:
    diameter = torch.tensor(corner.sphere_diameter / 1.6, dtype=torch.float64)
    step = 1e-4
    columns = []
    for axis in torch.eye(6, dtype=torch.float64):
        more, less = (
            corner.outer(
                PoseAction.from_delta(sign * step * axis).apply_centred(aside, diameter, crop)
            )
            for sign in (1, -1)
        )
        turn = log_so3(more.rotation @ less.rotation.mT)
        columns.append(torch.cat([more.translation - less.translation, turn]) / (2 * step))
    expected = torch.stack(columns, -1)
    found = update_jacobian(aside, corner, diameter, crop)
    torch.testing.assert_close(found, expected, atol=1e-9, rtol=1e-6)


def test_the_covariance_is_that_of_updates_drawn_with_this_information(
    corner: Mesh, aside: Pose
) -> None:
    diameter = torch.tensor(corner.sphere_diameter, dtype=torch.float64)
    generator = torch.Generator().manual_seed(0)
    root = torch.randn(6, 6, generator=generator, dtype=torch.float64) + 3 * torch.eye(6)
    information, error = root @ root.mT * 400, 2.0
    spread = torch.linalg.cholesky(torch.linalg.inv(information)) * error
    deltas = torch.randn(20_000, 6, generator=generator, dtype=torch.float64) @ spread.mT
    many = Pose(aside.rotation.expand(len(deltas), 3, 3), aside.translation.expand(len(deltas), 3))
    moved = corner.outer(
        PoseAction.from_delta(deltas).apply_centred(many, diameter.expand(len(deltas)))
    )
    here = corner.outer(aside)
    turns = log_so3(moved.rotation @ here.rotation.mT)
    drawn = torch.cov(torch.cat([moved.translation - here.translation, turns], -1).mT)
    known = Information(information, diameter, "look_at", error)
    found = pose_covariance(known, aside, corner)
    scale = found.diagonal().sqrt()
    scale = scale[:, None] * scale
    torch.testing.assert_close(drawn / scale, found / scale, atol=0.05, rtol=0)


def test_where_nothing_is_known_the_covariance_is_large_and_finite(
    corner: Mesh, aside: Pose
) -> None:
    diameter = torch.tensor(corner.sphere_diameter, dtype=torch.float64)
    found = pose_covariance(Information(torch.zeros(6, 6), diameter, "look_at", 3.0), aside, corner)
    degrees = torch.rad2deg(found[3:, 3:].diagonal().sqrt())
    torch.testing.assert_close(degrees, torch.full((3,), LONGEST, dtype=torch.float64))


def test_a_network_says_how_uncertain_it_is_and_less_where_more_is_covered(brick: Mesh) -> None:
    scene = Scene(brick, 3, 4, "easy")
    seen = scene.render_frame(0)
    covered = seen.image.copy()
    width = covered.shape[1]
    column = int(scene.camera.fx * seen.pose.translation[0] / seen.pose.translation[2] + width / 2)
    covered[:, column:] = 90
    targets = [Target(image, scene.camera, brick, seen.pose) for image in (seen.image, covered)]
    tools = {"policy": load_policy(), "renderer": make_renderer()}
    whole, half = (one.covariance for one in refine_batch(targets, **tools))
    assert whole is not None and half is not None
    assert not whole.is_inference(), "it can be added to in place"
    torch.testing.assert_close(whole, whole.mT)
    assert bool((torch.linalg.eigvalsh(whole) > 0).all())
    assert float(torch.logdet(half) - torch.logdet(whole)) > 1


def test_an_oracle_does_not_say(corner: Mesh) -> None:
    truth = Pose.from_rvec([0, 0, 0], [0, 0, 0.9])
    scene = Scene(corner, 0, 2, "easy")
    target = Target(scene.render_frame(0).image, scene.camera, corner, truth)
    oracle = OraclePolicy(Pose.stack([corner.inner(truth)]))
    [result] = refine_batch([target], policy=oracle, renderer=make_renderer())
    assert result.pose is not None and result.covariance is None


def test_an_error_of_no_pixels_is_refused() -> None:
    with pytest.raises(InputError, match="displacement_error must be positive"):
        LoopConfig(displacement_error=0.0)


def test_equivalent_poses_have_the_covariance_of_their_own_origins(
    corner: Mesh, aside: Pose
) -> None:
    """As a tracker takes the equivalent that is turned least, after the loop."""
    turn = exp_so3(torch.tensor([0.0, 0.0, math.pi], dtype=torch.float64))
    other = Pose(aside.rotation @ turn, aside.translation)
    diameter = torch.tensor(corner.sphere_diameter, dtype=torch.float64)
    matrix = torch.diag(torch.tensor([1.0, 2.0, 3.0, 4.0, 5.0, 6.0], dtype=torch.float64))
    known = Information(matrix, diameter, "look_at", 2.0)
    end = Refined(aside, 1, StopReason.STOP_ACTION, 0.9, 1.0, information=known)
    middle = Mesh.from_arrays("middle", corner.vertices, FACES)  # its origin is its centre
    covariances = []
    for pose in (aside, other):
        result = replace(end, centred=pose).result(corner)
        assert result.pose is not None and result.covariance is not None
        covariances.append(result.covariance)
        arm = (result.pose.translation - pose.translation).numpy()
        # Where the centre is again, seen from the origin: what it is of the centre itself.
        back = np.eye(6)
        back[:3, 3:] = np.stack([np.cross(arm, axis) for axis in np.eye(3)], 1)
        found = back @ result.covariance.numpy() @ back.T
        expected = pose_covariance(known, pose, middle)
        np.testing.assert_allclose(found, expected.numpy(), rtol=1e-4, atol=1e-12)
    assert (covariances[0] - covariances[1]).abs().max() > 0.1 * covariances[0].abs().max()
