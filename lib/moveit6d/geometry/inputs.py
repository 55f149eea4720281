"""Poses and cameras as users hand them over, as the types that the library works with.

Never opens a file: a path where an object is meant is an error that names who reads it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from .camera import Camera
from .pose import Pose

Kind = TypeVar("Kind")
ROUNDING = 1e-6  # by which rotations in float32 are off


def instance_of(value: Any, kind: type[Kind], name: str, remedy: str) -> Kind:
    """The value itself; `InputError` with a remedy where it is not of a class."""
    if not isinstance(value, kind):
        raise InputError(f"The {name} must be a {kind.__name__}, found {kind_of(value)}; {remedy}.")
    return value


def camera_of(camera: Any) -> Camera:
    """The camera itself; `InputError` for anything else."""
    remedy = "Camera.from_matrix(K, width, height, distortion) or Camera.load(path) makes one"
    return instance_of(camera, Camera, "camera", remedy)


def poses_of(poses: Any, name: str = "Start pose") -> list[Pose]:
    """One pose or several as a list: `Pose`, 4×4 matrices of any kind of array, lists of both.

    They are float64 on the CPU and have no gradient, whatever the given ones are. `InputError` for
    what is no pose: a rotation is checked as `Pose.checked` does.
    """
    if isinstance(poses, Pose):
        poses = _proper(poses, name)
        return [poses] if not poses.batch_shape else [poses[k] for k in range(len(poses))]
    shape = _shape(poses)
    if shape[-2:] == (4, 4) and len(shape) <= 3:
        found = Pose.from_matrix(_array(poses))
        return poses_of(found)
    if not is_list(poses):
        raise InputError(
            f"{name} must be a Pose or a 4×4 matrix, found {kind_of(poses)}; "
            "Pose.checked(rotation, translation) makes one."
        )
    return [pose for one in poses for pose in poses_of(one, name)]


def pose_of(pose: Any, name: str = "Start pose") -> Pose:
    """A single pose; `InputError` for several."""
    found = poses_of(pose, name)
    if len(found) != 1:
        raise InputError(f"{name} must be a single one, found {len(found)}.")
    return found[0]


def _proper(pose: Pose, name: str) -> Pose:
    """The pose in float64, with the nearest rotation where its own is slightly off."""
    checked = Pose.checked(pose.rotation, pose.translation, name)
    plain = pose.detach().to(torch.device("cpu")).to(torch.float64)
    # One that is right stays as it is to the last digit: results do not depend on who made it.
    near = torch.allclose(checked.rotation, plain.rotation, rtol=0, atol=ROUNDING)
    return plain if near else checked


def is_list(value: Any) -> bool:
    """Whether a value is a list or tuple of things, not a text."""
    return isinstance(value, Sequence) and not isinstance(value, str | bytes)


def _shape(value: Any) -> tuple[int, ...]:
    """The shape of an array or of nested lists of numbers; empty for anything else."""
    if isinstance(value, np.ndarray | Tensor):
        return tuple(value.shape)
    if not is_list(value) or any(isinstance(one, Pose) for one in value):
        return ()
    try:
        return np.asarray(value, np.float64).shape
    except (TypeError, ValueError, RuntimeError):  # the last of tensors that require a gradient
        return ()


def _array(value: Any) -> Any:
    return value.detach().cpu().numpy() if isinstance(value, Tensor) else np.asarray(value)


def kind_of(value: Any) -> str:
    """What a value is, in few words."""
    if isinstance(value, np.ndarray | Tensor):
        return f"an array of shape {tuple(value.shape)}"
    if isinstance(value, str):
        return f"the text {value!r:.60}"
    return type(value).__name__
