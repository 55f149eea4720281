"""Poses: group laws as properties, and refusal of numbers that are no pose."""

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from moveit6d.errors import InputError
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3

number = st.floats(-3, 3, allow_nan=False)
poses = st.builds(
    lambda w, t: Pose(
        exp_so3(torch.tensor(w, dtype=torch.float64)), torch.tensor(t, dtype=torch.float64)
    ),
    st.tuples(number, number, number),
    st.tuples(number, number, number),
)


def close(a: Pose, b: Pose, tolerance: float = 1e-9) -> bool:
    return bool((a.matrix() - b.matrix()).abs().max() < tolerance)


@given(poses, poses, poses)
@settings(max_examples=50, deadline=None)
def test_composition_is_associative_and_is_the_matrix_product(a: Pose, b: Pose, c: Pose) -> None:
    assert close((a @ b) @ c, a @ (b @ c))
    assert torch.allclose((a @ b).matrix(), a.matrix() @ b.matrix(), atol=1e-9)


@given(poses)
@settings(max_examples=50, deadline=None)
def test_inverse_undoes(pose: Pose) -> None:
    assert close(pose @ pose.inverse(), Pose.identity())
    assert close(Pose.from_matrix(pose.matrix()), pose, 1e-15)


def test_transform_maps_object_to_camera() -> None:
    """X_cam = R X_obj + t: a quarter turn about z and a step forward."""
    turn = [[0.0, -1, 0], [1, 0, 0], [0, 0, 1]]
    pose = Pose.checked(turn, [0.0, 0, 2])
    moved = pose.transform(torch.tensor([[1.0, 0, 0]], dtype=torch.float64))
    assert moved.tolist() == [[0.0, 1.0, 2.0]]


def test_batches_index_and_stack() -> None:
    batch = Pose.stack([Pose.identity(), Pose.identity()])
    assert batch.batch_shape == (2,) and len(batch) == 2
    assert batch[0].batch_shape == ()


@pytest.mark.parametrize(
    ("rotation", "message"),
    [
        (np.zeros((3, 3)), "not a rotation"),
        (np.diag([1.0, 1, -1]), "left-handed"),
        (np.eye(3) * 1000, "not a rotation"),
        (np.full((3, 3), np.nan), "not finite"),
        (np.eye(4), "3×3"),
        ([["a"]], "must be numbers"),
    ],
)
def test_what_is_no_rotation_is_refused(rotation: object, message: str) -> None:
    with pytest.raises(InputError, match=f"start.json.*{message}"):
        Pose.checked(rotation, [0, 0, 1], where="start.json")


def test_translations_are_checked() -> None:
    with pytest.raises(InputError, match="not finite"):
        Pose.checked(np.eye(3), [0, 0, np.inf])
    with pytest.raises(InputError, match="3 numbers"):
        Pose.checked(np.eye(3), [0, 0])


def test_slightly_wrong_rotations_are_projected() -> None:
    """Four objects of the published Linemod-Occlusion are off by up to 0.0096."""
    pose = Pose.checked(np.eye(3) + 0.004, [0, 0, 1])
    product = pose.rotation @ pose.rotation.mT
    assert torch.allclose(product, torch.eye(3, dtype=torch.float64), atol=1e-12)


def test_flat_rotations_are_row_major() -> None:
    pose = Pose.checked([0, -1, 0, 1, 0, 0, 0, 0, 1], [0, 0, 1])
    assert pose.rotation[1, 0] == 1


def test_shapes_must_agree() -> None:
    with pytest.raises(InputError, match="must be"):
        Pose(torch.eye(3), torch.zeros(2, 3))
