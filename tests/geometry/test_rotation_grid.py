"""The coarse grid of rotations: rotations they are, everywhere near, always the same."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from moveit6d.errors import InputError
from moveit6d.geometry.rotation_grid import rotation_grid


def farthest(grid: torch.Tensor) -> float:
    """Largest angle, degrees, from 500 random rotations to the nearest of the grid."""
    everywhere = Rotation.random(500, random_state=np.random.RandomState(0)).as_quat()
    cosine = np.abs(everywhere @ Rotation.from_matrix(grid.numpy()).as_quat().T).clip(0, 1)
    return float(np.degrees(2 * np.arccos(cosine.max(1)).max()))


def test_they_are_rotations() -> None:
    grid = rotation_grid(50)
    torch.testing.assert_close(grid @ grid.mT, torch.eye(3).double().expand(50, 3, 3))
    torch.testing.assert_close(torch.linalg.det(grid), torch.ones(50).double())


def test_more_of_them_leave_smaller_gaps() -> None:
    """The optimum for 60 is the icosahedron's group, 44.5 degrees; random ones leave about 90."""
    assert farthest(rotation_grid(60)) < 62
    assert farthest(rotation_grid(500)) < 30


def test_the_same_number_is_the_same_set() -> None:
    assert torch.equal(rotation_grid(7), rotation_grid(7))


def test_none_is_refused() -> None:
    with pytest.raises(InputError, match="0 rotations"):
        rotation_grid(0)
