"""Rotations against SciPy, and at the places where formulas break."""

import math

import pytest
import torch
from scipy.spatial.transform import Rotation

from moveit6d.geometry.rotation import (
    exp_so3,
    log_so3,
    nearest_rotation,
    random_rotations,
    rotation_angle,
)


def vectors(count: int, longest: float, seed: int = 0) -> torch.Tensor:
    generator = torch.Generator().manual_seed(seed)
    direction = torch.randn(count, 3, dtype=torch.float64, generator=generator)
    length = torch.rand(count, 1, dtype=torch.float64, generator=generator) * longest
    return torch.nn.functional.normalize(direction, dim=-1) * length


def test_exponential_agrees_with_scipy() -> None:
    vector = vectors(500, 9.0)
    expected = torch.from_numpy(Rotation.from_rotvec(vector.numpy()).as_matrix())
    torch.testing.assert_close(exp_so3(vector), expected, atol=1e-12, rtol=0)


def test_logarithm_agrees_with_scipy() -> None:
    rotation = random_rotations(500, torch.Generator().manual_seed(1))
    expected = torch.from_numpy(Rotation.from_matrix(rotation.numpy()).as_rotvec())
    torch.testing.assert_close(log_so3(rotation), expected, atol=1e-10, rtol=0)


@pytest.mark.parametrize("length", [0.0, 1e-12, 1e-7, 1e-4, math.pi - 1e-4, math.pi - 1e-9])
def test_logarithm_undoes_the_exponential_at_hard_angles(length: float) -> None:
    vector = torch.nn.functional.normalize(vectors(50, 1.0, seed=2), dim=-1) * length
    torch.testing.assert_close(log_so3(exp_so3(vector)), vector, atol=1e-8, rtol=0)


def test_half_turns_have_a_logarithm_of_length_pi() -> None:
    for axis in torch.eye(3, dtype=torch.float64):
        rotation = exp_so3(axis * math.pi)
        assert rotation_angle(rotation).item() == pytest.approx(math.pi, abs=1e-9)


def test_gradients_exist_at_the_identity() -> None:
    zero = torch.zeros(1, 3, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda v: log_so3(exp_so3(v)), zero)


def test_nearest_rotation_repairs_and_never_mirrors() -> None:
    rotation = random_rotations(50, torch.Generator().manual_seed(3))
    noisy = rotation + 0.01 * torch.randn(50, 3, 3, dtype=torch.float64)
    fixed = nearest_rotation(noisy)
    identity = torch.eye(3, dtype=torch.float64).expand(50, 3, 3)
    torch.testing.assert_close(fixed @ fixed.mT, identity, atol=1e-12, rtol=0)
    assert (torch.linalg.det(nearest_rotation(-noisy)) > 0).all()
    assert (fixed - rotation).abs().max() < 0.05
