"""Poses: group laws as properties, and refusal of numbers that are no pose."""

import json
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from moveit6d.errors import InputError
from moveit6d.geometry.pose import Pose, in_metres
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
    return bool((a.matrix - b.matrix).abs().max() < tolerance)


@given(poses, poses, poses)
@settings(max_examples=50, deadline=None)
def test_composition_is_associative_and_is_the_matrix_product(a: Pose, b: Pose, c: Pose) -> None:
    assert close((a @ b) @ c, a @ (b @ c))
    assert torch.allclose((a @ b).matrix, a.matrix @ b.matrix, atol=1e-9)


@given(poses)
@settings(max_examples=50, deadline=None)
def test_inverse_undoes(pose: Pose) -> None:
    assert close(pose @ pose.inverse(), Pose.identity())
    assert close(Pose.from_matrix(pose.matrix), pose, 1e-15)


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


@pytest.mark.parametrize("order", ["xyzw", "wxyz"])
def test_quaternions_are_scipys(order: Literal["xyzw", "wxyz"]) -> None:
    turn = Rotation.random(5, random_state=0)
    quaternion = turn.as_quat(canonical=True, scalar_first=order == "wxyz")
    pose = Pose.from_quaternion(quaternion.astype(np.float32), np.zeros((5, 3)), order=order)
    np.testing.assert_allclose(pose.rotation.numpy(), turn.as_matrix(), atol=1e-6)
    np.testing.assert_allclose(pose.quaternion(order).numpy(), quaternion, atol=1e-6)


@pytest.mark.parametrize(
    ("quaternion", "order", "message"),
    [
        ([0, 0, 0, 2], "xyzw", "length 1"),
        ([0, 0, 1], "xyzw", "4 finite numbers"),
        ([0, 0, float("nan"), 1], "xyzw", "finite"),
        ([0, 0, 0, 1], "wzyx", "order is 'wzyx'"),
    ],
)
def test_what_is_no_quaternion_is_refused(
    quaternion: list[float], order: Any, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        Pose.from_quaternion(quaternion, [0, 0, 1], order=order)


def test_an_order_that_is_none_is_refused_both_ways() -> None:
    with pytest.raises(InputError, match=r"Pose\.quaternion: the order is 'XYZW', must be 'xyzw'"):
        Pose.identity().quaternion("XYZW")  # type: ignore[arg-type]


def test_equal_is_the_same_object() -> None:
    pose, twin = Pose.identity(), Pose.identity()
    assert pose == pose and pose != twin
    assert pose in [twin, pose] and pose not in [twin]
    assert len({pose, twin}) == 2


def test_vectors_are_those_of_opencv() -> None:
    rvec, tvec = np.array([[0.3], [-0.5], [2.0]], np.float32), np.array([[0.1], [0.2], [0.7]])
    pose = Pose.from_rvec(rvec, tvec)
    np.testing.assert_allclose(pose.rotation.numpy(), cv2.Rodrigues(rvec)[0], atol=1e-6)
    assert pose.translation.tolist() == [0.1, 0.2, 0.7] and pose.batch_shape == ()
    with pytest.raises(InputError, match="rvec must be 3"):
        Pose.from_rvec([1.0, 2.0], tvec)


def test_a_pose_reads_well() -> None:
    pose = Pose.from_rvec([0, 0, np.pi / 2], [0.1, -0.02, 0.6])
    text = "Pose(translation=[0.1000, -0.0200, 0.6000] m, rotation=[0.00, 0.00, 90.00] deg)"
    assert repr(pose) == text
    assert repr(Pose.identity(2, 3)) == "Pose(batch of (2, 3), torch.float64)"


def test_what_a_pose_file_says_besides_is_not_dropped_in_silence(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    content = {"rotation": np.eye(3).tolist(), "translation": [0, 0, 1], "unit": "mm"}
    (tmp_path / "pose.json").write_text(json.dumps(content))
    with pytest.raises(InputError, match="its unit is 'mm', but a pose's translation is in metres"):
        Pose.load(tmp_path / "pose.json")
    content.update(unit="m", frame="camera_optical")
    (tmp_path / "pose.json").write_text(json.dumps(content))
    Pose.load(tmp_path / "pose.json")
    assert "frame not used" in caplog.text


def test_a_saved_pose_comes_back_exactly(tmp_path: Path) -> None:
    pose = Pose.from_rvec([0.3, -0.5, 2.0], [0.1, 0.2, 0.7])
    pose.save(tmp_path / "pose.json")
    back = Pose.load(str(tmp_path / "pose.json"))
    assert torch.allclose(back.matrix, pose.matrix, atol=1e-15, rtol=0)
    with pytest.raises(InputError, match="holds one pose"):
        Pose.identity(2).save(tmp_path / "two.json")


def test_a_matrix_is_a_pose_file(tmp_path: Path) -> None:
    pose = Pose.from_rvec([0.3, -0.5, 2.0], [0.1, 0.2, 0.7])
    matrix = pose.matrix.numpy()
    np.savetxt(tmp_path / "blanks.txt", matrix)
    np.savetxt(tmp_path / "commas.csv", matrix, delimiter=",")
    (tmp_path / "list.json").write_text(json.dumps(matrix.tolist()))
    (tmp_path / "rows.json").write_text(json.dumps(matrix.tolist()).replace("], ", "],\n"))
    for path in tmp_path.iterdir():
        assert close(Pose.load(path), pose, 1e-12), path.name
    np.savetxt(tmp_path / "turned.txt", matrix.T)
    with pytest.raises(InputError, match=r"turned\.txt: the last row .* transposed"):
        Pose.load(tmp_path / "turned.txt")
    np.savetxt(tmp_path / "mirrored.txt", np.diag([1.0, 1, -1, 1]))
    with pytest.raises(InputError, match=r"mirrored\.txt: the rotation is left-handed"):
        Pose.load(tmp_path / "mirrored.txt")


@pytest.mark.parametrize(
    "content",
    [b"", b"hello", b"[1, 2]", b"3", b"1 0 0 0\n0 1 0 0\n", b"{", b"\x93NUMPY", b"[" * 9999],
)
def test_a_file_of_another_kind_says_what_a_pose_file_holds(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "start").write_bytes(content)
    with pytest.raises(InputError) as caught:
        Pose.load(tmp_path / "start")
    assert str(caught.value).startswith(f"{tmp_path / 'start'} ")
    assert str(caught.value).endswith(
        '; a pose file holds {"rotation": 3x3, "translation": [x, y, z]}, metres, or a 4x4 matrix.'
    )


def test_how_far_an_object_stands_is_judged_by_its_middle() -> None:
    far = np.array([200.0, 0.0, 0.0])
    pose = Pose.from_rvec([0, 0, 0.7], [0, 0, 0])
    seen = Pose(pose.rotation, torch.tensor([0, 0, 0.5]) - pose.rotation @ torch.from_numpy(far))
    assert in_metres(seen, "start.json", far) is seen
    with pytest.raises(
        InputError, match=r"start\.json: the object stands 200 m away; .* millimetres"
    ):
        in_metres(seen, "start.json")
    with pytest.raises(InputError, match="millimetres"):
        in_metres(Pose(seen.rotation, 1000 * seen.translation), "start.json", far)
    near = Pose.from_rvec([0, 0, 0], [0, 0, 0.5])
    assert in_metres(near, "start.json", far) is near, "whatever it is, it is not in millimetres"


def test_points_of_every_kind_are_moved() -> None:
    pose = Pose.from_rvec([0.1, -0.2, 0.3], [0.01, -0.02, 0.5])
    points = torch.tensor([[0.1, 0.0, 0.5], [0.25, -0.5, 1.0]], dtype=torch.float64)
    expected = pose.transform(points)
    for values in (
        points.tolist(),
        points.numpy(),
        points.float(),
        points.numpy().astype(np.float32),
    ):
        found = pose.transform(values)
        assert found.dtype == torch.float64
        torch.testing.assert_close(found, expected, rtol=0, atol=1e-7)
    torch.testing.assert_close(pose.transform(points[0]), expected[0])
    both = Pose.stack([pose, pose]).transform(points[0])
    torch.testing.assert_close(both, expected[:1].expand(2, 3))
    moving = points.clone().requires_grad_()
    assert pose.transform(moving).requires_grad
    for wrong in ([[0.0, 1.0]], "points", [[0.0, 1.0, 2.0], [1.0]]):
        with pytest.raises(InputError, match=r"Pose\.transform: .*points must be"):
            pose.transform(wrong)  # type: ignore[arg-type]


def test_another_shape_than_4x4_is_no_matrix() -> None:
    for matrix in (np.eye(3), np.eye(4)[:3]):
        for values in (matrix, matrix.tolist(), torch.from_numpy(matrix)):
            with pytest.raises(InputError, match=r"found shape \(3, [34]\), not 4×4"):
                Pose.from_matrix(values)


def test_no_poses_are_an_empty_batch() -> None:
    none = np.zeros((0, 3))
    for pose in (
        Pose.checked(np.zeros((0, 3, 3)), none),
        Pose.from_matrix(np.zeros((0, 4, 4))),
        Pose.from_matrix(torch.zeros(0, 4, 4)),
        Pose.from_quaternion(np.zeros((0, 4)), none, "xyzw"),
        Pose.from_rvec(none, none),
    ):
        assert pose.batch_shape == (0,)
    with pytest.raises(InputError, match="no pose to stack"):
        Pose.stack([])


def test_whole_numbers_and_two_types_become_one_floating_type() -> None:
    whole = Pose(torch.eye(3, dtype=torch.int64), torch.tensor([0, 0, 1]))
    mixed = Pose(torch.eye(3), torch.zeros(3, dtype=torch.float64))
    for pose in (whole, mixed):
        assert pose.rotation.dtype == pose.translation.dtype == torch.float64
        assert pose.transform([0.0, 0.0, 0.0]).shape == (3,)
    both = Pose.identity() @ Pose.identity(dtype=torch.float32)
    assert both.rotation.dtype == both.translation.dtype == torch.float64


def test_a_pose_is_composed_with_poses_only() -> None:
    with pytest.raises(InputError, match=r"found a Tensor; Pose\.from_matrix\(matrix\) makes one"):
        Pose.identity() @ torch.eye(4)  # type: ignore[operator]
