"""Symmetric objects: no delta holds a rotation that cannot be seen."""

import math

import numpy as np
import pytest
import torch

from moveit6d.actions import PoseAction, pose_delta
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3, random_rotations
from moveit6d.geometry.symmetry import ContinuousSymmetry, Symmetries
from moveit6d.synthesis.objects import primitives as make
from moveit6d.synthesis.training.equivalents import nearest_delta, rotation_distance

OFFSET = np.array([0.03, -0.02, 0.05])


def can(symmetries: Symmetries) -> Mesh:
    """A cylinder about z, away from its file's origin."""
    part = make.cylinder(0.04, 0.1)
    return Mesh.from_arrays("can", part.vertices + OFFSET, part.faces, symmetries=symmetries)


ROUND = can(Symmetries(continuous=(ContinuousSymmetry(np.array([0.0, 0.0, 1.0]), OFFSET),)))
PLAIN = can(Symmetries())


def centred(mesh: Mesh) -> np.ndarray:
    return mesh.symmetries.centred(mesh.center)


def some_start(count: int) -> tuple[Pose, torch.Tensor]:
    ahead = torch.tensor([0.02, -0.03, 0.6], dtype=torch.float64).expand(count, 3)
    pose = Pose(random_rotations(count, torch.Generator().manual_seed(0)), ahead)
    return pose, torch.full((count,), ROUND.sphere_diameter, dtype=torch.float64)


def test_symmetries_turn_the_centred_object_about_its_own_middle() -> None:
    motions = torch.from_numpy(ROUND.symmetries.centred(ROUND.center))
    assert torch.allclose(motions[0], torch.eye(4, dtype=torch.float64))
    points = torch.from_numpy(ROUND.vertices).double()
    for motion in motions[[40, 157]]:
        moved = points @ motion[:3, :3].T + motion[:3, 3]
        assert torch.allclose(moved.norm(dim=1), points.norm(dim=1), atol=1e-6)
        assert torch.allclose(moved[:, 2], points[:, 2], atol=1e-6)


def test_a_spun_can_needs_no_turn_and_a_can_without_symmetry_does() -> None:
    start, diameter = some_start(6)
    angles = torch.tensor([0.0, 0.3, 1.0, 2.0, 3.0, -1.5], dtype=torch.float64)
    spin = exp_so3(torch.stack([0 * angles, 0 * angles, angles], -1))
    goal = Pose(start.rotation @ spin, start.translation)
    delta = nearest_delta([centred(ROUND)] * 6, start, goal, diameter)
    assert delta[:, 3:].abs().max() < 0.6, "half a step of BOP's 315"
    plain = nearest_delta([centred(PLAIN)] * 6, start, goal, diameter)
    assert plain[:, 3:].norm(dim=1) == pytest.approx(torch.rad2deg(angles.abs()), abs=1e-3)


def test_other_moves_stay_and_the_spin_in_them_goes() -> None:
    """Tilt and shift of the goal remain; what is left looks like the goal."""
    start, diameter = some_start(5)
    generator = torch.Generator().manual_seed(1)
    delta = (torch.rand(5, 6, generator=generator, dtype=torch.float64) - 0.5) * 20
    goal = PoseAction.from_delta(delta).apply_centred(start, diameter)
    spin = exp_so3(torch.tensor([0.0, 0.0, 2.0], dtype=torch.float64))
    spun = Pose(goal.rotation @ spin, goal.translation)
    near = nearest_delta([centred(ROUND)] * 5, start, spun, diameter)
    again = nearest_delta([centred(ROUND)] * 5, start, goal, diameter)
    assert torch.allclose(near, again, atol=1.2)
    assert (near.abs().amax(1) <= delta.abs().amax(1) + 0.6).all()
    reached = PoseAction.from_delta(near).apply_centred(start, diameter)
    axis = torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    assert torch.allclose(reached.rotation @ axis, goal.rotation @ axis, atol=1e-9)
    assert torch.allclose(reached.translation, goal.translation, atol=1e-9)


def test_discrete_symmetries_and_mixed_batches() -> None:
    flip = np.eye(4)
    flip[:3, :3] = make.about(0, math.pi)
    flip[:3, 3] = OFFSET - flip[:3, :3] @ OFFSET
    turning = can(Symmetries(flip[None]))
    start, diameter = some_start(2)
    half = exp_so3(torch.tensor([math.pi - 1e-3, 0.0, 0.0], dtype=torch.float64))
    goal = Pose(start.rotation @ half, start.translation)
    delta = nearest_delta([centred(turning), centred(PLAIN)], start, goal, diameter)
    assert delta[0].abs().max() < 0.1 and delta[1, 3:].norm() > 179
    assert torch.equal(delta[1], pose_delta(start, goal, diameter)[1])


def test_the_angle_between_two_rotations_is_that_to_the_nearest_equivalent() -> None:
    start, _ = some_start(2)
    spin = exp_so3(torch.tensor([0.0, 0.0, 2.0], dtype=torch.float64))
    tilt = exp_so3(torch.tensor([0.4, 0.0, 0.0], dtype=torch.float64))
    angles = rotation_distance(
        [centred(ROUND), centred(PLAIN)], start.rotation, start.rotation @ spin
    )
    assert angles[0] < 0.6 and angles[1] == pytest.approx(math.degrees(2.0), abs=1e-6)
    tilted = rotation_distance([centred(ROUND)] * 2, start.rotation, start.rotation @ tilt @ spin)
    assert tilted == pytest.approx([math.degrees(0.4)] * 2, abs=0.01), "of 315 turns the nearest"
