"""What users hand to trackers, estimators and detectors, as the types that they work with.

Never opens a file: a path where an object is meant is an error that names who reads it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import Policy, load_policy
from ..rendering.backends import make_renderer
from ..rendering.renderer import Renderer

ROUNDING = 1e-6  # by which rotations in float32 are off


def meshes_of(meshes: Any) -> list[Mesh]:
    """One mesh or several as a list; `InputError` for anything else."""
    given = [meshes] if isinstance(meshes, Mesh) or not _is_list(meshes) else list(meshes)
    for mesh in given:
        if not isinstance(mesh, Mesh):
            raise InputError(
                f"The mesh must be a Mesh, found {_kind(mesh)}; Mesh.load(path, unit) reads one."
            )
    return given


def policy_of(policy: Policy | None) -> Policy:
    """The policy; the shipped network if None."""
    return load_policy() if policy is None else policy


def renderer_of(renderer: Renderer | None) -> Renderer:
    """The back end; embree if None."""
    return make_renderer() if renderer is None else renderer


def camera_of(camera: Any) -> Camera:
    """The camera itself; `InputError` for anything else."""
    if not isinstance(camera, Camera):
        raise InputError(
            f"The camera must be a Camera, found {_kind(camera)}; "
            "Camera.from_matrix(K, width, height, distortion) or Camera.load(path) makes one."
        )
    return camera


def poses_of(poses: Any, name: str = "Start pose") -> list[Pose]:
    """One pose or several as a list: `Pose`, 4×4 matrices of any kind of array, lists of both.

    `InputError` for what is no pose: a rotation is checked as `Pose.checked` does.
    """
    if isinstance(poses, Pose):
        poses = _proper(poses, name)
        return [poses] if not poses.batch_shape else [poses[k] for k in range(len(poses))]
    shape = _shape(poses)
    if shape[-2:] == (4, 4) and len(shape) <= 3:
        found = Pose.from_matrix(_array(poses))
        return poses_of(found)
    if not _is_list(poses):
        raise InputError(
            f"{name} must be a Pose or a 4×4 matrix, found {_kind(poses)}; "
            "Pose.checked(rotation, translation) makes one."
        )
    return [pose for one in poses for pose in poses_of(one, name)]


def start_poses_of(poses: Any, count: int) -> list[Pose | None]:
    """A pose or None for each of so many meshes; `InputError` for another number of poses."""
    if poses is None:
        return [None] * count
    given: list[Pose | None] = []
    if isinstance(poses, Sequence) and any(pose is None for pose in poses):
        for pose in poses:
            given += [None] if pose is None else poses_of(pose)
    else:
        given += poses_of(poses)
    if count != len(given):
        raise InputError(f"{count} meshes need as many start poses, found {len(given)}.")
    return given


def pose_of(pose: Any, name: str = "Start pose") -> Pose:
    """A single pose; `InputError` for several."""
    if isinstance(pose, Pose):
        return _proper(pose, name)
    found = poses_of(pose, name)
    if len(found) != 1:
        raise InputError(f"{name} must be a single one, found {len(found)}.")
    return found[0]


def _proper(pose: Pose, name: str) -> Pose:
    """The pose itself, with the nearest rotation where its own is slightly off."""
    checked = Pose.checked(pose.rotation, pose.translation, name)
    # One that is right stays as it is to the last digit: results do not depend on who made it.
    off = (checked.rotation - pose.rotation.detach().to("cpu", torch.float64)).abs().max()
    return pose if off < ROUNDING else checked


def _is_list(value: Any) -> bool:
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _shape(value: Any) -> tuple[int, ...]:
    """The shape of an array or of nested lists of numbers; empty for anything else."""
    if isinstance(value, np.ndarray | Tensor):
        return tuple(value.shape)
    if not _is_list(value) or any(isinstance(one, Pose) for one in value):
        return ()
    try:
        return np.asarray(value, np.float64).shape
    except (TypeError, ValueError):
        return ()


def _array(value: Any) -> Any:
    return value.detach().cpu().numpy() if isinstance(value, Tensor) else np.asarray(value)


def _kind(value: Any) -> str:
    """What a value is, in few words."""
    if isinstance(value, np.ndarray | Tensor):
        return f"an array of shape {tuple(value.shape)}"
    if isinstance(value, str):
        return f"the text {value!r:.60}"
    return type(value).__name__
