"""The 13 actions, their sums (`PoseAction`), and the expert that knows which one is best.

Never renders and never knows a network. Counts are measured in the patch of the current pose:

* t_x, t_y: one unit moves the object's projected centre by one patch pixel (right, down);
* t_z: one unit makes the projected diameter one patch pixel larger (the object comes nearer);
* r_x, r_y, r_z: one unit is one degree; the three are one rotation vector about axes parallel to
  the look-at camera's, through the object's centre.

METHOD 3; paper, section "Method".
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import torch
from torch import Tensor

from .geometry.crop import OBJECT_SIZE, Crop, view_of
from .geometry.pose import Pose
from .geometry.rotation import exp_so3, log_so3

AXES = ("t_x", "t_y", "t_z", "r_x", "r_y", "r_z")


class ActionSpace(IntEnum):
    """The 13 actions of the paper in the order of the network's logits."""

    T_X_PLUS = 0
    T_X_MINUS = 1
    T_Y_PLUS = 2
    T_Y_MINUS = 3
    T_Z_PLUS = 4
    T_Z_MINUS = 5
    R_X_PLUS = 6
    R_X_MINUS = 7
    R_Y_PLUS = 8
    R_Y_MINUS = 9
    R_Z_PLUS = 10
    R_Z_MINUS = 11
    STOP = 12


@dataclass(frozen=True)
class PoseAction:
    """Signed step counts on the six axes and whether to stop.

    `counts` (..., 6) in the order of `AXES`; integers are the paper's sums V of actions, real
    numbers are what regression gives. `stop` (...) is boolean.
    """

    delta: Tensor
    stop: Tensor

    @staticmethod
    def of(delta: Tensor) -> PoseAction:
        """A move that does not stop."""
        stop = torch.zeros(delta.shape[:-1], dtype=torch.bool, device=delta.device)
        return PoseAction(delta, stop)

    @staticmethod
    def from_index(index: Tensor, step: float = 1.0) -> PoseAction:
        """Single actions (...) of `ActionSpace`, each `step` units long."""
        return PoseAction.from_one_hot(torch.nn.functional.one_hot(index, 13), step)

    @staticmethod
    def from_one_hot(one_hot: Tensor, step: float = 1.0) -> PoseAction:
        """From vectors v (..., 13) of zeros and one 1, the paper's notation."""
        value = one_hot.to(torch.float64)
        return PoseAction((value[..., 0:12:2] - value[..., 1:12:2]) * step, one_hot[..., 12] > 0)

    def one_hot(self) -> Tensor:
        """Vectors (..., 13) of a single action; the inverse of `from_one_hot` for any step.

        A move along several axes at once has no such vector: `ValueError`.
        """
        moves = torch.stack([self.delta > 0, self.delta < 0], -1).flatten(-2)
        vector = torch.cat([moves, self.stop[..., None]], -1)
        if not (vector.sum(-1) == 1).all():
            raise ValueError("PoseAction.one_hot: each action must be one single move or stop.")
        return vector.to(torch.int64)

    def __add__(self, other: PoseAction) -> PoseAction:
        """Sum of counts; stops if either does."""
        return PoseAction(self.delta + other.delta, self.stop | other.stop)

    def apply(self, pose: Pose, sphere_diameter: Tensor, crop: Crop = "look_at") -> Pose:
        """Centred poses (...) after the move. `sphere_diameter` (...) in metres. METHOD 3."""
        view = view_of(pose, sphere_diameter, crop)
        delta = self.delta.to(pose.translation)
        depth = view.distance * OBJECT_SIZE / (OBJECT_SIZE + delta[..., 2])
        # In the virtual frame one patch pixel at this depth is depth / focal metres.
        metres = depth / view.intrinsics[..., 0, 0]
        place = (delta[..., :2] - view.axis) * metres[..., None]
        virtual = torch.cat([place, depth[..., None]], -1)
        turn = view.rotation.mT @ exp_so3(torch.deg2rad(delta[..., 3:])) @ view.rotation
        translation = (view.rotation.mT @ virtual[..., None])[..., 0]
        return Pose(turn @ pose.rotation, translation)


def pose_delta(start: Pose, goal: Pose, sphere_diameter: Tensor, crop: Crop = "look_at") -> Tensor:
    """Counts (..., 6) that take `start` to `goal`: the exact inverse of `PoseAction.apply`.

    The goal must lie in front of the virtual camera that looks at `start`; turns are the shorter
    way round. Differentiable except at half turns. METHOD 3.
    """
    view = view_of(start, sphere_diameter, crop)
    seen = view.to_virtual(goal).translation
    focal = view.intrinsics[..., 0, 0]
    t_x = focal * seen[..., 0] / seen[..., 2] + view.axis[..., 0]
    t_y = focal * seen[..., 1] / seen[..., 2] + view.axis[..., 1]
    t_z = OBJECT_SIZE * (view.distance / seen[..., 2] - 1)
    turn = view.rotation @ goal.rotation @ start.rotation.mT @ view.rotation.mT
    return torch.cat([torch.stack([t_x, t_y, t_z], -1), torch.rad2deg(log_so3(turn))], -1)


def expert_action(delta: Tensor, step: float = 1.0) -> Tensor:
    """The best single action (...) for the counts (..., 6) that remain: an `ActionSpace` index.

    It shortens the largest remaining count; with every count under half a step it stops. This is
    the paper's argmin with the largest absolute count as pose error (METHOD 4).
    """
    largest, axis = delta.abs().max(-1)
    sign = delta.gather(-1, axis[..., None])[..., 0] < 0
    stop = torch.full_like(axis, int(ActionSpace.STOP))
    return torch.where(largest < 0.5 * step, stop, axis * 2 + sign.to(axis.dtype))


def expert_delta(
    start: Pose, goal: Pose, sphere_diameter: Tensor, symmetries: Tensor | None = None,
    crop: Crop = "look_at",
) -> Tensor:  # fmt: skip
    """Counts (6,) to the nearest of the goal's equivalents; poses unbatched and centred.

    `symmetries` (S, 4, 4) map the centred object onto itself; the choice is the shortest vector of
    counts: by the largest count alone, which is often a shift, any turn would be as good. METHOD 4.
    """
    if symmetries is None or len(symmetries) < 2:
        return pose_delta(start, goal, sphere_diameter, crop)
    goals = goal @ Pose.from_matrix(symmetries.to(goal.translation))
    starts = Pose(
        start.rotation.expand_as(goals.rotation), start.translation.expand_as(goals.translation)
    )
    delta = pose_delta(starts, goals, sphere_diameter.expand(len(goals)), crop)
    return delta[delta.norm(dim=-1).argmin()]
