"""What users hand to trackers, estimators and detectors, as the types that they work with.

Never opens a file: a path where an object is meant is an error that names who reads it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..config import TrackerConfig
from ..errors import InputError
from ..geometry.inputs import camera_of as camera_of
from ..geometry.inputs import instance_of, is_list, kind_of, poses_of
from ..geometry.inputs import pose_of as pose_of
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import Policy, load_policy
from ..rendering.backends import NAMES, make_renderer
from ..rendering.renderer import Renderer


def meshes_of(meshes: Any) -> list[Mesh]:
    """One mesh or several as a list; `InputError` for none and for anything else."""
    given = [meshes] if isinstance(meshes, Mesh) or not is_list(meshes) else list(meshes)
    if not given:
        raise InputError("The list of meshes is empty; give the Mesh of each object.")
    return [instance_of(mesh, Mesh, "mesh", "Mesh.load(path, unit) reads one") for mesh in given]


def policy_of(policy: Policy | None) -> Policy:
    """The policy; the shipped network if None, `InputError` for what cannot predict."""
    if policy is None:
        return load_policy()
    if not callable(getattr(policy, "predict", None)):
        raise InputError(
            f"The policy must be a Policy, found {kind_of(policy)}; load_policy(path) reads one."
        )
    return policy


def renderer_of(renderer: Renderer | None) -> Renderer:
    """The back end; embree if None, `InputError` for what cannot render."""
    if renderer is None:
        return make_renderer()
    if not callable(getattr(renderer, "render", None)):
        raise InputError(
            f"The renderer must be a Renderer, found {kind_of(renderer)}; make_renderer(name) "
            f"makes one of {', '.join(NAMES)}."
        )
    return renderer


def config_of(config: Any) -> TrackerConfig:
    """The configuration itself; `InputError` for anything else."""
    remedy = "TrackerConfig(low_confidence=0.4) makes one, with every other setting as it is"
    return instance_of(config, TrackerConfig, "config", remedy)


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
