"""The action decision process: crop, render, predict, update, until a stop rule ends it.

Never knows a network, only the policy protocol. Paper, section "Method"; docs/method.md.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Any

import torch
from torch import Tensor

from ..actions import PoseAction, pose_delta
from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.crop import Crop, View, crop_patch, view_of
from ..geometry.mesh import Mesh, sphere_diameters
from ..geometry.pose import Pose
from ..geometry.visibility import why_unseen
from ..networks.policy_output import PolicyOutput
from ..observation import Observation, observe
from ..policies import ActionMode, LoopState, Policy, to_action
from ..rendering.renderer import Renderer
from .frame import Frame, prepare_frame
from .localizability import localizability

# Iterations at most: the paper's limit for single steps. With all axes at once, of 160 rendered
# cases of held-out training objects, far starts and a third covered, 74.4, 76.9 and 76.2 % end
# below 10 % of the diameter with six, eight and eleven; from small disturbances they are the same.
MAX_ITERATIONS = {ActionMode.SINGLE: 30, ActionMode.ALL_AXES: 8}
# Coarse to fine: near the object a real-valued policy sees its middle, so many times
# larger, in which what is left of the error is as many times larger too.
FINE_SCALE = 1.6
FINE_THRESHOLD = 5.0  # units on every axis: a delta below this enters the fine stage


class StopReason(StrEnum):
    """Why a loop ended."""

    STOP_ACTION = "stop_action"
    REVISITED = "revisited"  # a pose of this loop came again: oscillation
    MAX_ITERATIONS = "max_iterations"
    FAILED = "failed"  # no pose; the result's `error` says why


@dataclass(frozen=True)
class Target:
    """One object to look for in one image; the pose is in the mesh file's frame.

    `image` is RGB (H, W, 3), or a `Frame` if several targets or loops share it; `depth_bias` are
    the units of t_z that the policy is known to be off by in the fine stage (`calibration`);
    `close` says that the pose is so near that it should do that at once.
    """

    image: Any
    camera: Camera
    mesh: Mesh
    pose: Pose
    depth_bias: float = 0.0
    fine: bool = False


@dataclass(frozen=True)
class TrackingResult:
    """The outcome of a loop.

    `pose` is unbatched float64 in the mesh file's frame, None if it failed; `confidence` in [0, 1]
    is the policy's belief that the pose looks right, `localizability` in [0, 1] the chance that one
    that does is right (`precision`); `milliseconds` passed until this object was done.
    """

    pose: Pose | None
    iterations: int
    stopped_by: StopReason
    confidence: float
    milliseconds: float
    error: str | None = None
    localizability: float = 0.0

    @property
    def score(self) -> float:
        """How likely the pose is within a tenth of the diameter: both chances together."""
        return self.confidence * self.localizability


def refine_batch(
    targets: Sequence[Target],
    *,
    policy: Policy,
    renderer: Renderer,
    max_iterations: int | None = None,
    step_size: float = 1.0,
    groups: Sequence[int] | None = None,
) -> list[TrackingResult]:
    """Refine all targets at once, one batch per iteration; each ends by its own stop rule.

    A policy of all six axes enters the fine stage (`FINE_SCALE`) once the delta is small, and
    before it stops. `max_iterations` is `MAX_ITERATIONS` of the policy's mode if None; `step_size`
    is the length of single actions. `groups` numbers targets that are several starts for one
    object: after the first iteration only the most confident of each group goes on, and the results
    are one per group, in the order of the targets. Raises `InputError` if an image does not fit its
    camera or a start pose is out of sight.
    """
    if not targets:
        return []
    limit = MAX_ITERATIONS[policy.mode] if max_iterations is None else max_iterations
    found = _loops(targets, policy, renderer, limit, step_size, groups)
    # Tensors made in inference mode are no use for anybody who wants gradients of a pose.
    return [
        replace(one, pose=Pose(one.pose.rotation.clone(), one.pose.translation.clone()))
        if one.pose is not None
        else one
        for one in found
    ]


@torch.inference_mode()  # half the time of small tensors' arithmetic is autograd's
def _loops(
    targets: Sequence[Target],
    policy: Policy,
    renderer: Renderer,
    limit: int,
    step_size: float,
    groups: Sequence[int] | None,
) -> list[TrackingResult]:
    """`refine_batch`, one result for each target, or one for each group."""
    begin = time.perf_counter()
    batch = _Batch.of(targets)
    pose = batch.pose
    trajectories = [_Trajectory(*one) for one in zip(batch.cameras, batch.meshes, strict=True)]
    results: list[TrackingResult | None] = [None] * len(targets)
    active = torch.arange(len(targets))
    coarse_to_fine = policy.mode is ActionMode.ALL_AXES
    scale = torch.tensor(
        [FINE_SCALE if coarse_to_fine and target.fine else 1.0 for target in targets]
    )
    objects = active if groups is None else torch.as_tensor(groups)
    for iteration in range(1, limit + 1):
        if not len(active):
            break
        fine = scale[active] > 1
        diameter, current = batch.diameter[active] / scale[active], pose[active]
        observation = batch.observe(active, current, diameter, renderer, policy.crop)
        prediction = policy.predict(observation, LoopState(current, diameter, objects[active]))
        prediction = _corrected(prediction, batch.depth_bias[active] * fine)
        action = to_action(prediction, policy.mode, step_size)
        moved = action.apply_centred(current, diameter, policy.crop)
        going = []
        for row, i in enumerate(active.tolist()):
            end = trajectories[i].add(moved[row], diameter[row], action, prediction.confidence, row)
            if (
                coarse_to_fine
                and not fine[row]
                and _reaches_fine_stage(action, row, end, limit - iteration)
            ):
                scale[i], end = FINE_SCALE, None
                trajectories[i].start_fine_stage()
            if end is None and iteration == limit:
                end = StopReason.MAX_ITERATIONS
            if end is None:
                going.append(row)
                continue
            results[i] = trajectories[i].result(end, iteration, (time.perf_counter() - begin) * 1e3)
        if iteration == 1 and groups is not None:
            chosen = _best(groups, trajectories)
            results = [result if i in chosen else None for i, result in enumerate(results)]
            going = [row for row in going if int(active[row]) in chosen]
        pose = _replaced(pose, active, moved)
        active = active[going]
    return [result for result in results if result is not None]


def _reaches_fine_stage(action: PoseAction, row: int, end: StopReason | None, left: int) -> bool:
    """Whether to enter the fine stage: `left` iterations are left, `end` is why it would end."""
    if end is StopReason.FAILED:
        return False
    near = end is not None or bool(action.delta[row].abs().max() < FINE_THRESHOLD)
    return (near and left > 0) or left == 1


def _replaced(poses: Pose, index: Tensor, moved: Pose) -> Pose:
    """The poses (N) with those at `index` (M) replaced by others (M)."""
    return Pose(
        poses.rotation.index_copy(0, index, moved.rotation),
        poses.translation.index_copy(0, index, moved.translation),
    )


def _corrected(prediction: PolicyOutput, depth_bias: Tensor) -> PolicyOutput:
    """The prediction with the depth bias taken off its delta."""
    if prediction.delta is None:
        return prediction
    delta = prediction.delta.clone()
    delta[:, 2] -= depth_bias
    return replace(prediction, delta=delta)


def _best(groups: Sequence[int], trajectories: Sequence[_Trajectory]) -> set[int]:
    """The target of each group with the most confident first iteration; failures come last."""
    members: dict[int, list[int]] = {}
    for i, group in enumerate(groups):
        members.setdefault(group, []).append(i)
    return {max(some, key=lambda i: trajectories[i].belief) for some in members.values()}


@dataclass(frozen=True)
class _Batch:
    """What stays the same during a loop, and the centred float64 poses (N) it starts from."""

    images: list[Tensor]
    cameras: list[Camera]
    intrinsics: list[Tensor]
    meshes: list[Mesh]
    diameter: Tensor
    depth_bias: Tensor
    pose: Pose

    @staticmethod
    def of(targets: Sequence[Target]) -> _Batch:
        prepared: dict[tuple[int, Camera], Frame] = {}
        for target in targets:  # several objects may share an image: prepare it once
            key = (id(target.image), target.camera)
            if key not in prepared:
                prepared[key] = prepare_frame(target.image, target.camera)
        frames = [prepared[id(target.image), target.camera] for target in targets]
        for target, frame in zip(targets, frames, strict=True):
            check_start(target.pose, target.mesh, frame.camera)
        poses = [target.mesh.inner(target.pose.to(torch.float64)) for target in targets]
        return _Batch(
            [frame.pixels for frame in frames],
            [frame.camera for frame in frames],
            [frame.camera.matrix() for frame in frames],
            [target.mesh for target in targets],
            sphere_diameters(target.mesh for target in targets),
            torch.tensor([t.depth_bias for t in targets]),
            Pose.stack(poses),
        )

    def observe(
        self, active: Tensor, pose: Pose, diameter: Tensor, renderer: Renderer, crop: Crop
    ) -> Observation:
        """Crop and render for the active targets at their current poses.

        `diameter` are those of the spheres, metres, that fill the patches.
        """
        chosen = active.tolist()
        view = view_of(pose, diameter, crop)
        patches = [
            crop_patch(
                self.images[i],
                View(view.rotation[row], view.intrinsics[row], view.distance[row]),
                self.intrinsics[i],
            )
            for row, i in enumerate(chosen)
        ]
        meshes = [self.meshes[i] for i in chosen]
        gbuffer = renderer.render(meshes, view.to_virtual(pose), view.intrinsics)
        return observe(torch.stack(patches), gbuffer, view, diameter)


class _Trajectory:
    """The poses that one target has visited, and whether the next one ends its loop."""

    def __init__(self, camera: Camera, mesh: Mesh) -> None:
        self.camera, self.mesh = camera, mesh
        self.error = ""
        self.poses: list[Pose] = []
        self.confidences: list[float] = []
        self.belief = -1.0  # in the best of its poses
        self.best = -1

    def add(
        self, pose: Pose, diameter: Tensor, action: PoseAction, confidence: Tensor, row: int
    ) -> StopReason | None:
        """Record the pose after an update; the reason to stop now, if there is one.

        `diameter` is that of the sphere, metres, that filled the patch.
        """
        self.error = "an update led to numbers that are not finite"
        if torch.isfinite(pose.translation).all():
            self.error = why_unseen(pose, self.mesh, self.camera) or ""
        if self.error:
            return StopReason.FAILED
        seen_before = self._revisited(pose, diameter)
        self.poses.append(pose)
        self.confidences.append(float(confidence[row]))
        self.belief = max(self.belief, self.confidences[-1])
        if bool(action.stop[row]) or seen_before is None:
            self.best = len(self.poses) - 1
            return StopReason.STOP_ACTION if bool(action.stop[row]) else None
        iteration = range(seen_before, len(self.poses))
        self.best = max(iteration, key=lambda i: self.confidences[i])
        return StopReason.REVISITED

    def start_fine_stage(self) -> None:
        """Forget the poses so far: in the fine stage the same pose means a smaller difference."""
        self.poses, self.confidences, self.best = [], [], -1

    def _revisited(self, pose: Pose, diameter: Tensor) -> int | None:
        """The first earlier pose that is the same to half a step on every axis."""
        if not self.poses:
            return None
        earlier = Pose.stack(self.poses)
        here = Pose(
            pose.rotation.expand_as(earlier.rotation),
            pose.translation.expand_as(earlier.translation),
        )
        delta = pose_delta(here, earlier, diameter.expand(len(earlier)))
        same = (delta.abs().amax(-1) < 0.5).nonzero()
        return int(same[0, 0]) if len(same) else None

    def result(self, reason: StopReason, iterations: int, milliseconds: float) -> TrackingResult:
        if reason is StopReason.FAILED or not self.poses:
            # What to check is for starts; a track that got here began well.
            error = f"The object is lost: {self.error.split(';')[0]}."
            return TrackingResult(None, iterations, StopReason.FAILED, 0.0, milliseconds, error)
        pose = self.mesh.outer(self.poses[self.best])
        confidence = self.confidences[self.best]
        certain = localizability(pose, self.mesh, self.camera)
        return TrackingResult(
            pose, iterations, reason, confidence, milliseconds, localizability=certain
        )


def check_start(pose: Pose, mesh: Mesh, camera: Camera) -> None:
    """Refuse a start pose (mesh file's frame) whose object the camera cannot see at all."""
    if pose.batch_shape != ():
        raise InputError(f"Start pose must be a single one, found batch {tuple(pose.batch_shape)}.")
    if not (torch.isfinite(pose.rotation).all() and torch.isfinite(pose.translation).all()):
        raise InputError("Start pose holds a number that is not finite.")
    problem = why_unseen(mesh.inner(pose.to(torch.float64)), mesh, camera)
    if problem is not None:
        raise InputError(f"Start pose: {problem}.")
