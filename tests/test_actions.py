"""`PoseAction`: a test for each sentence of the convention, inverses as properties, expert."""

import math
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from moveit6d.actions import (
    ActionSpace,
    PoseAction,
    expert_action,
    expert_delta,
    pose_delta,
)
from moveit6d.errors import InputError
from moveit6d.geometry.camera import project
from moveit6d.geometry.crop import OBJECT_SIZE, Crop, axis_parallel, look_at
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3, random_rotations

DIAMETER = torch.tensor(0.15, dtype=torch.float64)


def a_pose(seed: int = 0) -> Pose:
    generator = torch.Generator().manual_seed(seed)
    place = torch.tensor([0.12, -0.08, 0.9], dtype=torch.float64)
    return Pose(random_rotations(1, generator)[0], place)


def after(delta: list[float], pose: Pose) -> Pose:
    return PoseAction.from_delta(torch.tensor(delta, dtype=torch.float64)).apply_centred(
        pose, DIAMETER
    )


def patch_pixel(pose: Pose, goal: Pose) -> torch.Tensor:
    """Where the goal's centre lies in the patch of `pose`, from the patch's middle."""
    view = look_at(pose, DIAMETER)
    seen = view.to_virtual(goal).translation
    return project(seen, view.intrinsics) - view.intrinsics[:2, 2]


# Convention: "t_x, t_y: one unit moves the projected centre by one patch pixel (right, down)".
def test_one_unit_of_shift_is_one_patch_pixel_right_and_down() -> None:
    pose = a_pose()
    torch.testing.assert_close(
        patch_pixel(pose, after([1, 0, 0, 0, 0, 0], pose)), torch.tensor([1.0, 0.0]).double()
    )
    torch.testing.assert_close(
        patch_pixel(pose, after([0, 1, 0, 0, 0, 0], pose)), torch.tensor([0.0, 1.0]).double()
    )


def test_in_an_axis_parallel_crop_turns_are_about_the_cameras_own_axes() -> None:
    pose = a_pose()
    delta = torch.tensor([3.0, -4.0, 2.0, 1.0, 2.0, -3.0], dtype=torch.float64)
    moved = PoseAction.from_delta(delta).apply_centred(pose, DIAMETER, "axis_parallel")
    view = axis_parallel(pose, DIAMETER)
    shift = project(moved.translation, view.intrinsics) - project(pose.translation, view.intrinsics)
    torch.testing.assert_close(shift, delta[:2])
    turn = Rotation.from_matrix((moved.rotation @ pose.rotation.mT).numpy())
    assert np.allclose(turn.as_rotvec(degrees=True), delta[3:].numpy(), atol=1e-9)
    width = view.intrinsics[0, 0] * DIAMETER / moved.translation[2]
    assert width.item() == pytest.approx(OBJECT_SIZE + 2)
    found = pose_delta(pose, moved, DIAMETER, "axis_parallel")
    torch.testing.assert_close(found, delta)


# Convention: "t_z: one unit makes the projected diameter one patch pixel larger (nearer)".
def test_one_unit_of_size_is_one_patch_pixel_of_diameter() -> None:
    pose = a_pose()
    near = after([0, 0, 1, 0, 0, 0], pose)
    focal = look_at(pose, DIAMETER).intrinsics[0, 0]
    width = focal * DIAMETER / near.translation.norm()
    assert width.item() == pytest.approx(OBJECT_SIZE + 1)
    assert near.translation.norm() < pose.translation.norm()


# Convention: "r: one unit is one degree about an axis parallel to the look-at camera's".
def test_one_unit_of_turn_is_one_degree_about_the_virtual_axes() -> None:
    pose = a_pose()
    view = look_at(pose, DIAMETER)
    for axis in range(3):
        delta = [0.0] * 6
        delta[3 + axis] = 1.0
        turned = after(delta, pose)
        turn = (view.rotation @ turned.rotation @ pose.rotation.mT @ view.rotation.mT).numpy()
        expected = np.zeros(3)
        expected[axis] = math.radians(1)
        assert np.allclose(Rotation.from_matrix(turn).as_rotvec(), expected, atol=1e-12)


# Convention: "through the object's centre".
def test_turns_leave_the_centre_where_it_is() -> None:
    pose = a_pose()
    torch.testing.assert_close(after([0, 0, 0, 10, -20, 30], pose).translation, pose.translation)


# Convention: "the three are one rotation vector".
def test_the_three_turns_are_one_rotation_vector() -> None:
    pose = Pose(torch.eye(3).double(), torch.tensor([0.0, 0, 1]).double())
    turned = after([0, 0, 0, 10, -20, 30], pose).rotation.numpy()
    expected = Rotation.from_rotvec([10, -20, 30], degrees=True).as_matrix()
    assert np.allclose(turned, expected, atol=1e-12)


count = st.floats(-40, 40, allow_nan=False)
delta = st.tuples(*[count] * 6)
places = st.tuples(st.floats(-0.5, 0.5), st.floats(-0.4, 0.4), st.floats(0.4, 3.0))
turns = st.tuples(*[st.floats(-3, 3)] * 3)


@given(delta, places, turns, st.floats(0.02, 0.3))
@settings(max_examples=200, deadline=None)
def test_difference_is_the_exact_inverse_of_apply(
    values: tuple[float, ...], place: tuple[float, ...], turn: tuple[float, ...], size: float
) -> None:
    pose = Pose(
        exp_so3(torch.tensor(turn, dtype=torch.float64)), torch.tensor(place, dtype=torch.float64)
    )
    diameter = torch.tensor(size, dtype=torch.float64)
    wanted = torch.tensor(values, dtype=torch.float64)
    moved = PoseAction.from_delta(wanted).apply_centred(pose, diameter)
    torch.testing.assert_close(pose_delta(pose, moved, diameter), wanted, atol=1e-9, rtol=0)


@given(places, turns, places, turns)
@settings(max_examples=100, deadline=None)
def test_apply_is_the_exact_inverse_of_difference(
    place_a: tuple[float, ...],
    turn_a: tuple[float, ...],
    place_b: tuple[float, ...],
    turn_b: tuple[float, ...],
) -> None:
    a, b = (
        Pose(exp_so3(torch.tensor(w, dtype=torch.float64)), torch.tensor(t, dtype=torch.float64))
        for w, t in ((turn_a, place_a), (turn_b, place_b))
    )
    if float(look_at(a, DIAMETER).to_virtual(b).translation[2]) < 0.05:
        return  # behind the virtual camera: `pose_delta` is not defined there
    found = PoseAction.from_delta(pose_delta(a, b, DIAMETER)).apply_centred(a, DIAMETER)
    torch.testing.assert_close(found.matrix, b.matrix, atol=1e-9, rtol=0)


def test_batches_give_what_single_poses_give() -> None:
    start = Pose.stack([a_pose(i) for i in range(4)])
    values = torch.randn(4, 6, dtype=torch.float64) * 10
    batch = PoseAction.from_delta(values).apply_centred(start, DIAMETER.expand(4))
    for i in range(4):
        single = PoseAction.from_delta(values[i]).apply_centred(start[i], DIAMETER)
        torch.testing.assert_close(batch[i].matrix, single.matrix)


def test_apply_is_differentiable() -> None:
    pose = a_pose()

    def move(values: torch.Tensor) -> torch.Tensor:
        return PoseAction.from_delta(values).apply_centred(pose, DIAMETER).matrix

    assert torch.autograd.gradcheck(move, torch.zeros(6, dtype=torch.float64, requires_grad=True))


def test_one_hot_to_and_fro() -> None:
    index = torch.arange(13)
    action = PoseAction.from_index(index, step_size=3.0)
    assert action.one_hot().argmax(-1).tolist() == index.tolist()
    again = PoseAction.from_one_hot(action.one_hot(), step_size=3.0)
    assert torch.equal(again.delta, action.delta) and torch.equal(again.stop, action.stop)
    assert action.delta[ActionSpace.R_Y_MINUS].tolist() == [0, 0, 0, 0, -3, 0]
    assert action.stop.tolist() == [False] * 12 + [True]


def test_an_update_along_two_axes_has_no_one_hot_vector() -> None:
    with pytest.raises(ValueError, match="one single action"):
        PoseAction.from_delta(torch.tensor([1.0, 1, 0, 0, 0, 0])).one_hot()


def test_sums_of_actions_are_the_paper_s_v() -> None:
    total = PoseAction.from_index(torch.tensor([0, 9])).delta.sum(0)
    assert total.tolist() == [1, 0, 0, 0, -1, 0]


@pytest.mark.parametrize("crop", ["look_at", "axis_parallel"])
def test_updates_compose_and_invert_on_poses_of_the_mesh_file(brick: Mesh, crop: Crop) -> None:
    pose = Pose(exp_so3(torch.tensor([0.3, -0.2, 0.5]).double()), torch.tensor([0.1, 0, 0.7]))
    first = PoseAction.from_delta(torch.tensor([4.0, -3, 6, 10, -5, 20]))
    second = PoseAction(torch.tensor([-2.0, 5, -4, 0, 15, -30]), torch.tensor(True))
    middle = first.apply(pose, brick, crop)
    end = second.apply(middle, brick, crop)
    both = first.then(second, pose, brick, crop)
    assert both.stop and torch.allclose(both.apply(pose, brick, crop).matrix, end.matrix)
    found = PoseAction.between(pose, middle, brick, crop)
    torch.testing.assert_close(found.delta, first.delta.double())
    back = first.inverse(pose, brick, crop).apply(middle, brick, crop)
    assert torch.allclose(back.matrix, pose.to(torch.float64).matrix)


# Convention: "n must be above −b, where the object is infinitely far".
@pytest.mark.parametrize("t_z", [-OBJECT_SIZE, -OBJECT_SIZE - 1, -1000, math.nan, math.inf])
def test_no_update_moves_the_object_behind_the_camera(brick: Mesh, t_z: float) -> None:
    delta = torch.tensor([[0.0] * 6, [0, 0, t_z, 0, 0, 0]], dtype=torch.float64)
    poses = Pose.stack([a_pose(), a_pose(1)])
    with pytest.raises(InputError, match=r"t_z above -91\.43"):
        PoseAction.from_delta(delta).apply(poses, brick)
    near = PoseAction.from_delta([0, 0, 1e-6 - OBJECT_SIZE, 0, 0, 0]).apply(a_pose(), brick)
    assert float(near.translation[2]) > 1e6


def test_no_update_leads_behind_the_camera(brick: Mesh) -> None:
    start = a_pose()
    for goal in (
        Pose(start.rotation, -start.translation),
        Pose(start.rotation, math.nan * start.translation),
    ):
        with pytest.raises(InputError, match="behind the virtual camera"):
            PoseAction.between(start, goal, brick)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"crop": "bad"}, "crop is 'bad', must be 'look_at' or 'axis_parallel'"),
        ({"start": np.eye(4)}, "pose must be a Pose"),
        ({"mesh": "drill.obj"}, "mesh must be a Mesh"),
    ],
)
def test_what_is_no_pose_mesh_or_crop_is_said(
    brick: Mesh, change: dict[str, Any], words: str
) -> None:
    given = {"start": a_pose(), "goal": a_pose(1), "mesh": brick, **change}
    with pytest.raises(InputError, match=words):
        PoseAction.between(**given)


def test_updates_are_made_of_every_kind_of_number() -> None:
    for values in (
        [1, 0, 0, 0, 0, -2],
        np.array([1, 0, 0, 0, 0, -2]),
        torch.tensor([1, 0, 0, 0, 0, -2]),
    ):
        action = PoseAction.from_delta(values)
        assert action.delta.tolist() == [1, 0, 0, 0, 0, -2] and action.delta.is_floating_point()
    for index in (ActionSpace.T_Y_MINUS, 3, np.int64(3), torch.tensor(3), torch.tensor(3.0)):
        assert PoseAction.from_index(index, 2).delta.tolist() == [0, -2, 0, 0, 0, 0]
    assert bool(PoseAction.from_index(ActionSpace.STOP).stop)
    assert PoseAction.from_index([ActionSpace.STOP, 0]).stop.tolist() == [True, False]
    assert PoseAction.from_one_hot(np.eye(13)).delta.shape == (13, 6)


@pytest.mark.parametrize("index", [13, -1, 0.5, math.nan, "stop", torch.tensor([0, 13])])
def test_what_is_no_action_is_said(index: Any) -> None:
    with pytest.raises(InputError, match=r"whole number from 0 to 12|must be numbers"):
        PoseAction.from_index(index)
    for make, values in ((PoseAction.from_delta, [0.0] * 5), (PoseAction.from_one_hot, [0.0] * 12)):
        with pytest.raises(InputError, match=r"must be \(\.\.\., (6|13)\), found shape"):
            make(values)


def test_updates_and_poses_of_other_shapes_are_said(brick: Mesh) -> None:
    poses = Pose.stack([a_pose(), a_pose(1)])
    assert PoseAction.from_delta(torch.zeros(6)).apply(poses, brick).batch_shape == (2,)
    with pytest.raises(InputError, match=r"shapes \(2,\) and \(3,\) do not fit"):
        PoseAction.from_delta(torch.zeros(3, 6)).apply(poses, brick)
    with pytest.raises(InputError, match=r"shapes \(2,\) and \(3,\) do not fit"):
        PoseAction.between(poses, poses[[0, 0, 1]], brick)


def test_updates_can_be_compared() -> None:
    one, other = PoseAction.from_index([0, 1]), PoseAction.from_index([0, 1])
    assert one == one and one != other and other in [one, other] and len({one, other}) == 2


def test_an_update_changes_its_type_and_device() -> None:
    action = PoseAction.from_delta(torch.ones(6)).to(torch.float64).to(torch.device("cpu"))
    assert action.delta.dtype is torch.float64 and not action.stop


def test_the_expert_shortens_the_largest_count_and_stops_in_time() -> None:
    remaining = torch.tensor(
        [
            [3.0, -4, 0, 0, 0, 0],
            [0.4, -0.4, 0.4, 0, 0, 0],
            [0, 0, 0, 0, 0, 7.0],
            [0, 0, -0.6, 0, 0, 0],
        ]
    )
    wanted = [ActionSpace.T_Y_MINUS, ActionSpace.STOP, ActionSpace.R_Z_PLUS, ActionSpace.T_Z_MINUS]
    assert expert_action(remaining).tolist() == wanted


def test_following_the_expert_ends_at_the_goal() -> None:
    goal = a_pose(3)
    pose = PoseAction.from_delta(torch.tensor([6.0, -4, 3, 5, -7, 2])).apply_centred(goal, DIAMETER)
    for _ in range(60):
        action = PoseAction.from_index(expert_action(pose_delta(pose, goal, DIAMETER)))
        if action.stop:
            break
        pose = action.apply_centred(pose, DIAMETER)
    assert action.stop
    assert pose_delta(pose, goal, DIAMETER).abs().max() < 0.5


def test_the_expert_takes_the_nearest_of_symmetric_goals() -> None:
    goal = a_pose(1)
    flip = torch.eye(4, dtype=torch.float64)
    flip[:3, :3] = exp_so3(torch.tensor([0.0, 0.0, math.pi], dtype=torch.float64))
    symmetries = torch.stack([torch.eye(4, dtype=torch.float64), flip])
    start = after([2, 0, 0, 0, 3, 0], goal @ Pose.from_matrix(flip))
    delta = expert_delta(start, goal, DIAMETER, symmetries)
    assert delta.abs().max() < 5
    assert expert_delta(start, goal, DIAMETER).abs().max() > 100
