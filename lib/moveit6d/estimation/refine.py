"""The action decision process: crop, render, predict, update, until every loop has ended.

Never knows a network, only the policy protocol. Paper, section "Method"; docs/method.md.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import torch
from torch import Tensor

from ..config import LoopConfig
from ..geometry.crop import PATCH_SIZE
from ..geometry.mesh import sphere_diameters
from ..geometry.pose import Pose
from ..networks.policy_output import PolicyOutput
from ..observation import Observation, observe
from ..policies import LoopState, Policy, mode_of, to_action
from ..rendering.renderer import Renderer
from .keyframes import recall
from .results import Refined, Start, Target, TrackingResult, starts_of
from .schedule import Schedule

DEFAULT = LoopConfig()


def refine_batch(
    targets: Sequence[Target],
    *,
    policy: Policy,
    renderer: Renderer,
    loop: LoopConfig = DEFAULT,
) -> list[TrackingResult]:
    """Refine all targets at once, one batch per iteration; each ends by its own stop rule.

    A target whose object the camera cannot see gives a failed result; `InputError` if an image does
    not fit its camera.
    """
    refined = refine_starts(starts_of(targets), policy=policy, renderer=renderer, loop=loop)
    return [one.result(target.mesh) for one, target in zip(refined, targets, strict=True)]


@torch.inference_mode()  # half the time of small tensors' arithmetic is autograd's
def refine_starts(
    starts: Sequence[Start],
    *,
    policy: Policy,
    renderer: Renderer,
    loop: LoopConfig = DEFAULT,
    groups: Sequence[int] | None = None,
    targets: Sequence[int] | None = None,
    size: int = PATCH_SIZE,
) -> list[Refined]:
    """`refine_batch` for starts.

    `groups` numbers starts for one object: after the first iteration only the most confident of
    each group goes on, and the results are one per group, in the order of the starts. `targets`
    are the numbers by which the policy knows the starts (`LoopState.target`): those of the groups
    if None, or without groups those of the rows. `size` is the side of the crops, pixels; others
    than the usual one do not go with keyframes.
    """
    if not starts:
        return []
    mode = mode_of(policy, loop.mode)
    schedule = Schedule(starts, loop, mode, groups, policy.crop)
    numbers = schedule.groups if targets is None else torch.as_tensor(targets)
    pose = Pose.stack([start.centred for start in starts])
    diameters = sphere_diameters(start.mesh for start in starts)
    depth_bias = torch.tensor([start.depth_bias for start in starts])
    while len(rows := schedule.active):
        frames, meshes = zip(*((starts[i].frame, starts[i].mesh) for i in rows), strict=True)
        current, diameter = pose[rows], diameters[rows] / schedule.scale[rows]
        observation = observe(frames, meshes, current, diameter, renderer, policy.crop, size)
        keyframes = [starts[i].keyframes for i in rows]
        observation = recall(observation, keyframes, meshes, current, diameter, policy.crop)
        state = LoopState(current, diameter, numbers[rows])
        output = policy.predict(observation, state)
        output = _without_bias(output, depth_bias[rows] * schedule.fine[rows])
        output = _sure_of_what_shows(output, observation, loop.least_shown)
        action = to_action(output, mode, loop.step_size, loop.stop_delta)
        updated = action.apply_centred(current, diameter, policy.crop)
        pose = _replaced(pose, rows, updated)
        schedule.advance(updated, diameter, action, output.confidence, output.information)
    return schedule.results()


def once_more(
    starts: Sequence[Start],
    results: Sequence[Refined],
    *,
    policy: Policy,
    renderer: Renderer,
    loop: LoopConfig,
    size: int = PATCH_SIZE,
) -> dict[int, Refined]:
    """One more iteration, in the fine stage, from where each result is; by index, where it is.

    With crops of `size` × `size` pixels.
    """
    rows = [(i, one.centred) for i, one in enumerate(results) if one.centred is not None]
    ends = refine_starts(
        [replace(starts[i], centred=centred, fine=True) for i, centred in rows],
        policy=policy,
        renderer=renderer,
        loop=replace(loop, max_iterations=1),
        targets=[i for i, _ in rows],
        size=size,
    )
    return {i: end for (i, _), end in zip(rows, ends, strict=True)}


def _without_bias(output: PolicyOutput, depth_bias: Tensor) -> PolicyOutput:
    """The prediction with the depth bias taken off its delta."""
    if output.delta is None:
        return output
    delta = output.delta.clone()
    delta[:, 2] -= depth_bias
    return replace(output, delta=delta)


def _sure_of_what_shows(output: PolicyOutput, observation: Observation, least: int) -> PolicyOutput:
    """The prediction, of confidence 0 where the rendering shows nothing: a sheet seen edge-on.

    A policy would find no difference there.
    """
    shown = observation.mask.sum((1, 2, 3)).to(output.confidence) >= least
    return replace(output, confidence=output.confidence * shown)


def _replaced(poses: Pose, index: Tensor, updated: Pose) -> Pose:
    """The poses (N) with those at `index` (M) replaced by others (M)."""
    return Pose(
        poses.rotation.index_copy(0, index, updated.rotation),
        poses.translation.index_copy(0, index, updated.translation),
    )
