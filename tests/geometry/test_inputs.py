"""Poses and cameras as users hand them over: right, or one sentence that names the type wanted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.inputs import camera_of, pose_of, poses_of
from moveit6d.geometry.pose import Pose

MATRIX = np.eye(4)
MATRIX[:3, :3] = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
MATRIX[:3, 3] = 0.01, -0.02, 0.5
POSE = Pose(torch.from_numpy(MATRIX[:3, :3]), torch.from_numpy(MATRIX[:3, 3]))
WAYS: list[Any] = [
    POSE,
    [POSE],
    (POSE,),
    Pose.stack([POSE]),
    MATRIX,
    [MATRIX],
    MATRIX[None],
    MATRIX.astype(np.float32),
    MATRIX.tolist(),
    torch.from_numpy(MATRIX),
    [torch.from_numpy(MATRIX).float()],
    Pose.from_matrix(MATRIX),
    Pose(MATRIX[:3, :3], MATRIX[:3, 3]),  # type: ignore[arg-type]
    Pose.checked(MATRIX[:3, :3], MATRIX[:3, 3:]),
]


@pytest.mark.parametrize("given", WAYS)
def test_one_pose_in_every_form(given: Any) -> None:
    (found,) = poses_of(given)
    assert isinstance(found.rotation, torch.Tensor)
    assert (found.matrix.double() - torch.from_numpy(MATRIX)).abs().max() < 1e-6
    assert torch.equal(pose_of(given).matrix.reshape(4, 4), found.matrix)


def test_several_poses() -> None:
    for given in ([POSE, MATRIX], np.stack([MATRIX] * 2), Pose.stack([POSE] * 2)):
        assert len(poses_of(given)) == 2
        with pytest.raises(InputError, match="single one, found 2"):
            pose_of(given)


@pytest.mark.parametrize(
    ("given", "words"),
    [
        (None, "found NoneType"),
        ("start.json", "the text 'start.json'"),
        (np.eye(3), r"shape \(3, 3\)"),
        ((MATRIX[:3, :3], MATRIX[:3, 3]), r"shape \(3, 3\)"),
        (MATRIX.T, "transposed"),
        (np.full((4, 4), np.nan), "last row|not finite"),
        (np.diag([2.0, 2.0, 2.0, 1.0]), "not a rotation"),
        ([1.0, 2.0], "found float"),
    ],
)
def test_what_is_no_pose_is_named(given: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        poses_of(given)


TURN = torch.from_numpy(MATRIX[:3, :3])
SHEARED = torch.eye(3, dtype=torch.float64)
SHEARED[0, 1] = 0.3


@pytest.mark.parametrize(
    ("rotation", "words"),
    [
        (1.1 * TURN, "not a rotation"),
        (TURN @ SHEARED, "not a rotation"),
        (TURN @ torch.diag(torch.tensor([1.0, 1.0, -1.0], dtype=torch.float64)), "left-handed"),
        (float("nan") * TURN, "not finite"),
    ],
)
def test_a_pose_that_is_no_rotation_is_refused(rotation: torch.Tensor, words: str) -> None:
    pose = Pose(rotation, POSE.translation)
    for given in (pose, [POSE, pose], Pose.stack([POSE, pose])):
        with pytest.raises(InputError, match=f"^Start pose: the .*{words}"):
            poses_of(given)
    with pytest.raises(InputError, match=f"^Start pose: the .*{words}"):
        pose_of(pose)


def test_a_pose_that_is_slightly_off_becomes_proper_and_others_stay() -> None:
    for given in (POSE, POSE.to(torch.float32)):
        for found in (pose_of(given), *poses_of(given)):
            assert torch.equal(found.matrix, given.matrix.double())
    (found,) = poses_of(Pose(1.01 * POSE.rotation, POSE.translation))
    torch.testing.assert_close(found.matrix, POSE.matrix)


def test_poses_become_plain_float64_numbers() -> None:
    turning = Pose(POSE.rotation.clone().requires_grad_(), POSE.translation.float())
    whole = Pose(torch.eye(3, dtype=torch.int64), torch.tensor([0, 0, 1]))
    for given in (turning, whole, [whole], Pose.stack([whole]), [turning.matrix]):
        (found,) = poses_of(given)
        for values in (found.rotation, found.translation):
            assert values.dtype == torch.float64 and not values.requires_grad


def test_a_camera_is_no_file_and_no_matrix() -> None:
    camera = Camera(1, 1, 0, 0, 2, 2)
    assert camera_of(camera) is camera
    for bad in (np.eye(3), "camera.json", None):
        with pytest.raises(InputError, match=r"must be a Camera.*from_matrix"):
            camera_of(bad)
