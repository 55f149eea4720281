"""A video: every frame starts where the one before ended.

Never reads files. One bad frame never ends a track. Paper, "Stopping Criteria & Tracking Mode".
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any

import torch

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import Policy, load_policy
from ..rendering.renderer import Renderer, make_renderer
from .frame import prepare_frame
from .loop import StopReason, Target, TrackingResult, check_start, refine_batch


class PoseTracker:
    """Follows one or several objects through the frames of one camera.

    Args:
        meshes: the object, or the objects, each with its pose in `start`.
        camera: the camera, lens distortion included if it has any.
        start: pose of each object in (or just before) the first frame, mesh file's frame.
        policy: who decides; the shipped network if None.
        renderer: the back end; embree if None.
        max_steps: limit of cycles a frame; `MAX_STEPS` of the policy's mode if None.
    """

    def __init__(
        self,
        meshes: Mesh | Sequence[Mesh],
        camera: Camera,
        start: Pose | Sequence[Pose],
        *,
        policy: Policy | None = None,
        renderer: Renderer | None = None,
        max_steps: int | None = None,
    ) -> None:
        self.meshes = [meshes] if isinstance(meshes, Mesh) else list(meshes)
        poses = [start] if isinstance(start, Pose) else list(start)
        if len(self.meshes) != len(poses):
            raise InputError(f"{len(self.meshes)} meshes but {len(poses)} start poses.")
        self.camera, self.max_steps = camera, max_steps
        for mesh, pose in zip(self.meshes, poses, strict=True):
            check_start(pose, mesh, camera)
        self.poses = [pose.to(torch.float64) for pose in poses]
        self.policy: Policy = load_policy() if policy is None else policy
        self.renderer = make_renderer() if renderer is None else renderer

    def update(self, image: Any) -> tuple[TrackingResult, ...]:
        """Results for the next frame, RGB (H, W, 3), one an object.

        A frame that cannot be used, or an object that cannot be followed in it, gives a failed
        result that says why; the next frame starts from the last pose found.
        """
        begin = time.perf_counter()
        try:
            frame = prepare_frame(image, self.camera)
            results = refine_batch(
                [
                    Target(frame, self.camera, mesh, pose)
                    for mesh, pose in zip(self.meshes, self.poses, strict=True)
                ],
                policy=self.policy,
                renderer=self.renderer,
                max_steps=self.max_steps,
            )
        except InputError as error:
            return (_failed(error, begin),) * len(self.meshes)
        for i, result in enumerate(results):
            if result.pose is not None:
                self.poses[i] = result.pose
        return tuple(results)


def _failed(error: InputError, begin: float) -> TrackingResult:
    milliseconds = (time.perf_counter() - begin) * 1e3
    return TrackingResult(None, 0, StopReason.FAILED, 0.0, milliseconds, str(error))
