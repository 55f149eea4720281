"""The 13 actions, `PoseAction`, and the expert that knows which action is best.

Never renders and never knows a network. A pose delta (..., 6) is measured in the crop of the pose
that it starts from, in action units:

* t_x, t_y: one unit moves the object's projected centre by one crop pixel (right, down);
* t_z: one unit makes the projected diameter one crop pixel larger (the object comes nearer);
* r_x, r_y, r_z: one unit is one degree; the three are one rotation vector about axes parallel to
  the look-at camera's, through the object's centre.

Source: the paper's section "Method"; docs/method.md has the formulas.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum
from typing import Any, get_args

import numpy as np
import torch
from torch import Tensor

from .errors import InputError
from .geometry.crop import OBJECT_SIZE, Crop, view_of
from .geometry.inputs import instance_of
from .geometry.mesh import Mesh
from .geometry.numbers import float64_of, vectors
from .geometry.pose import Pose
from .geometry.rotation import exp_so3, log_so3
from .typing import Numbers


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


@dataclass(frozen=True, eq=False)
class PoseAction:
    """A relative SE(3) update in action units, and whether to stop.

    `delta` (..., 6) is t_x, t_y, t_z, r_x, r_y, r_z; whole numbers are the paper's sums V of single
    actions, real numbers are what regression gives. `stop` (...) is boolean.

    `between`, `apply`, `then` and `inverse` work on poses in the mesh file's frame, those that
    users have. What an update means in metres depends on the pose that it starts from, so that
    composition and inversion need that pose too. Two updates are equal only if they are the same
    object.

    Examples:
        >>> import torch
        >>> from moveit6d import PoseAction
        >>> PoseAction.from_delta(torch.tensor([2.0, 0, 0, 0, 0, 5])).delta
        tensor([2., 0., 0., 0., 0., 5.])
    """

    delta: Tensor
    stop: Tensor

    @staticmethod
    def from_delta(delta: Numbers) -> PoseAction:
        """An update by a delta (..., 6) that does not stop."""
        delta = vectors(delta, 6, "PoseAction.from_delta", "delta")
        stop = torch.zeros(delta.shape[:-1], dtype=torch.bool, device=delta.device)
        return PoseAction(delta, stop)

    @staticmethod
    def from_index(index: Any, step_size: float = 1.0) -> PoseAction:
        """Single actions (...) of `ActionSpace`, each `step_size` units long.

        One of `ActionSpace`, or whole numbers from 0 to 12; `InputError` for others.

        >>> PoseAction.from_index(ActionSpace.T_X_PLUS).delta.tolist()
        [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
        """
        given = index if isinstance(index, Tensor) else float64_of(index, "PoseAction", "index")
        whole = given.to(torch.int64)
        if not bool(((whole == given) & (whole >= 0) & (whole < len(ActionSpace))).all()):
            raise InputError("PoseAction.from_index: an action is a whole number from 0 to 12.")
        return PoseAction.from_one_hot(torch.nn.functional.one_hot(whole, 13), step_size)

    @staticmethod
    def from_one_hot(one_hot: Numbers, step_size: float = 1.0) -> PoseAction:
        """From vectors v (..., 13) of zeros and one 1, the paper's notation."""
        value = vectors(one_hot, 13, "PoseAction.from_one_hot", "one_hot").to(torch.float64)
        delta = (value[..., 0:12:2] - value[..., 1:12:2]) * step_size
        return PoseAction(delta, value[..., 12] > 0)

    @staticmethod
    def between(start: Pose, goal: Pose, mesh: Mesh, crop: Crop = "look_at") -> PoseAction:
        """The update that takes `start` to `goal`, poses (...) in the mesh file's frame.

        Exact inverse of `apply`. Rotations go the shorter way round. `InputError` for a goal that
        does not lie in front of the virtual camera that looks at `start`.
        """
        first, last = _centred(start, mesh, crop), _centred(goal, mesh, crop)
        _check_shapes(first.batch_shape, last.batch_shape)
        delta = pose_delta(first, last, _diameter(mesh, start), crop)
        if not _is_in_front(delta):
            raise InputError(
                "PoseAction.between: the goal lies behind the virtual camera that looks at the "
                "start; no update leads there."
            )
        return PoseAction.from_delta(delta)

    def apply(self, pose: Pose, mesh: Mesh, crop: Crop = "look_at") -> Pose:
        """Poses (...) in the mesh file's frame after the update; float64.

        `InputError` for a t_z of −b or less (b = `OBJECT_SIZE` = 91.4), which would move the object
        to infinity and beyond, behind the camera.
        """
        centred = _centred(pose, mesh, crop)
        _check_shapes(centred.batch_shape, self.delta.shape[:-1])
        if not _is_in_front(self.delta):
            raise InputError(
                f"PoseAction.apply: the delta must be finite and its t_z above {-OBJECT_SIZE:.2f}, "
                "beyond which no object is in front of the camera."
            )
        return mesh.outer(self.apply_centred(centred, _diameter(mesh, pose), crop))

    def then(self, other: PoseAction, pose: Pose, mesh: Mesh, crop: Crop = "look_at") -> PoseAction:
        """One update that does to `pose` what this one and then `other` do; stops if either does.

        `pose` (...) is in the mesh file's frame; `other` is measured in the crop of the pose after
        this update.
        """
        goal = other.apply(self.apply(pose, mesh, crop), mesh, crop)
        both = PoseAction.between(pose, goal, mesh, crop)
        return PoseAction(both.delta, self.stop | other.stop)

    def inverse(self, pose: Pose, mesh: Mesh, crop: Crop = "look_at") -> PoseAction:
        """The update that leads back to `pose` (...) after this one; mesh file's frame."""
        back = PoseAction.between(self.apply(pose, mesh, crop), pose, mesh, crop)
        return PoseAction(back.delta, self.stop)

    def to(self, target: torch.device | torch.dtype) -> PoseAction:
        """The same update on another device, or with another floating point type."""
        if isinstance(target, torch.dtype):
            return PoseAction(self.delta.to(target), self.stop)
        return PoseAction(self.delta.to(target), self.stop.to(target))

    def one_hot(self) -> Tensor:
        """Vectors (..., 13) of a single action; the inverse of `from_one_hot` for any step size.

        An update along several axes at once has no such vector: `InputError`.
        """
        signs = torch.stack([self.delta > 0, self.delta < 0], -1).flatten(-2)
        vector = torch.cat([signs, self.stop[..., None]], -1)
        if not (vector.sum(-1) == 1).all():
            raise InputError("PoseAction.one_hot: each must be one single action or stop.")
        return vector.to(torch.int64)

    def apply_centred(self, pose: Pose, sphere_diameter: Tensor, crop: Crop = "look_at") -> Pose:
        """Centred poses (...) after the update. `sphere_diameter` (...) in metres."""
        view = view_of(pose, sphere_diameter, crop)
        delta = self.delta.to(pose.translation)
        depth = view.distance * OBJECT_SIZE / (OBJECT_SIZE + delta[..., 2])
        # In the virtual frame one crop pixel at this depth is depth / focal metres.
        metres = depth / view.intrinsics[..., 0, 0]
        aside = (delta[..., :2] - view.axis) * metres[..., None]
        virtual = torch.cat([aside, depth[..., None]], -1)
        turn = view.rotation.mT @ exp_so3(torch.deg2rad(delta[..., 3:])) @ view.rotation
        translation = (view.rotation.mT @ virtual[..., None])[..., 0]
        return Pose(turn @ pose.rotation, translation)


def pose_delta(start: Pose, goal: Pose, sphere_diameter: Tensor, crop: Crop = "look_at") -> Tensor:
    """Pose delta (..., 6) from `start` to `goal`: the exact inverse of `PoseAction.apply_centred`.

    Poses (...) are centred; `PoseAction.between` takes those of the mesh file. The goal must lie in
    front of the virtual camera that looks at `start`; rotations go the shorter way round.
    Differentiable except at half turns.
    """
    view = view_of(start, sphere_diameter, crop)
    seen = view.to_virtual(goal).translation
    focal = view.intrinsics[..., 0, 0]
    t_x = focal * seen[..., 0] / seen[..., 2] + view.axis[..., 0]
    t_y = focal * seen[..., 1] / seen[..., 2] + view.axis[..., 1]
    t_z = OBJECT_SIZE * (view.distance / seen[..., 2] - 1)
    turn = view.rotation @ goal.rotation @ start.rotation.mT @ view.rotation.mT
    return torch.cat([torch.stack([t_x, t_y, t_z], -1), torch.rad2deg(log_so3(turn))], -1)


def expert_action(delta: Tensor, step_size: float = 1.0) -> Tensor:
    """The best single action (...) for the delta (..., 6) that remains: an `ActionSpace` index.

    It shortens the axis with the largest remaining delta; with all below half a step it stops.
    This is the paper's argmin with the largest absolute delta as pose error.
    """
    largest, axis = delta.abs().max(-1)
    sign = delta.gather(-1, axis[..., None])[..., 0] < 0
    stop = torch.full_like(axis, int(ActionSpace.STOP))
    return torch.where(largest < 0.5 * step_size, stop, axis * 2 + sign.to(axis.dtype))


def expert_delta(
    start: Pose,
    goal: Pose,
    sphere_diameter: Tensor,
    symmetries: Tensor | None = None,
    crop: Crop = "look_at",
) -> Tensor:
    """Pose delta (6,) to the nearest of the goal's equivalents; poses unbatched and centred.

    `symmetries` (S, 4, 4) map the centred object onto itself. The nearest is the one with the
    shortest delta: by the largest axis alone, which is often a shift, any turn would be as good.
    """
    if symmetries is None or len(symmetries) < 2:
        return pose_delta(start, goal, sphere_diameter, crop)
    goals = goal @ Pose.from_matrix(symmetries.to(goal.translation))
    starts = Pose(
        start.rotation.expand_as(goals.rotation), start.translation.expand_as(goals.translation)
    )
    delta = pose_delta(starts, goals, sphere_diameter.expand(len(goals)), crop)
    return delta[delta.norm(dim=-1).argmin()]


def rotate_delta(delta: Tensor, quarters: int) -> Tensor:
    """The delta (..., 6) in patches that are turned as `observation.rotated` does.

    Examples:
        >>> import torch
        >>> rotate_delta(torch.tensor([1.0, 0.0, 5.0, 0.0, 2.0, 3.0]), 1).tolist()
        [0.0, -1.0, 5.0, 2.0, -0.0, 3.0]
    """
    for _ in range(quarters % 4):
        x, y, z, about_x, about_y, about_z = delta.unbind(-1)
        delta = torch.stack([y, -x, z, about_y, -about_x, about_z], -1)
    return delta


def mirror_delta(delta: Tensor) -> Tensor:
    """The delta (..., 6) in patches whose right and left are exchanged: `observation.mirrored`.

    Shifts along x and turns about y and z change their signs.
    """
    return delta * delta.new_tensor([-1.0, 1.0, 1.0, 1.0, -1.0, -1.0])


def _centred(pose: Pose, mesh: Mesh, crop: Crop) -> Pose:
    """The centred pose in float64; `InputError` for what is no pose, no mesh and no crop."""
    if crop not in get_args(Crop):
        known = " or ".join(repr(name) for name in get_args(Crop))
        raise InputError(f"PoseAction: the crop is {crop!r}, must be {known}.")
    mesh = instance_of(mesh, Mesh, "mesh", "Mesh.load(path, unit) reads one")
    pose = instance_of(pose, Pose, "pose", "Pose.from_matrix(matrix) makes one")
    return mesh.inner(pose.to(torch.float64))


def _check_shapes(one: torch.Size, other: torch.Size) -> None:
    try:
        np.broadcast_shapes(one, other)
    except ValueError:
        raise InputError(
            f"PoseAction: shapes {tuple(one)} and {tuple(other)} do not fit together; give as "
            "many, or a single one."
        ) from None


def _is_in_front(delta: Tensor) -> bool:
    """Whether deltas (..., 6) end in front of the virtual camera: see `t_z`."""
    return bool((torch.isfinite(delta).all(-1) & (delta[..., 2] > -OBJECT_SIZE)).all())


def _diameter(mesh: Mesh, pose: Pose) -> Tensor:
    """The mesh's sphere diameter for poses (...)."""
    return pose.translation.new_tensor(mesh.sphere_diameter, dtype=torch.float64).expand(
        pose.batch_shape
    )
