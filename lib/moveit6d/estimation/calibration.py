"""What a policy gets wrong about one object, read where its pose is known.

A network sees an object a little too large or too small, and on the same side in every frame: its
mesh's colours, its camera and its light are not quite those of the training. Depth suffers most.
Never changes a pose.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from ..actions import PoseAction, pose_delta
from ..config import ActionMode, TrackerConfig
from ..policies import Policy, mode_of
from ..rendering.renderer import Renderer
from .refine import refine_starts
from .results import Start


def depth_bias(
    exact: Start, policy: Policy, renderer: Renderer, config: TrackerConfig, target: int = 0
) -> float:
    """By how many units of t_z the policy's updates will lead past the object in later frames.

    Read at a start whose pose is exact, for the policy one of the target with this number. 0 in
    mode single, which has no delta to correct, and without the fine stage.
    """
    settings, loop = config.calibration, config.loop
    if mode_of(policy, loop.mode) is ActionMode.SINGLE or not loop.fine_stage:
        return 0.0
    diameter = torch.tensor(exact.mesh.sphere_diameter, dtype=torch.float64)
    offsets = np.random.default_rng(0).normal(size=(settings.pairs, 6)) * settings.spread
    starts = [
        replace(exact, centred=action.apply_centred(exact.centred, diameter), fine=True)
        for action in map(_action, np.concatenate([offsets, -offsets]))
    ]
    once = replace(loop, max_iterations=1)
    targets = [target] * len(starts)
    refined = refine_starts(starts, policy=policy, renderer=renderer, loop=once, targets=targets)
    ends = [one.centred for one in refined if one.centred is not None]
    past = [float(pose_delta(exact.centred, end, diameter / loop.fine_scale)[2]) for end in ends]
    if not past:
        return 0.0
    # Of slender objects the depth that comes out depends on where the update started.
    agreement = 1 / (1 + (np.std(past) / settings.disagreement) ** 4)
    bias = settings.share * agreement * np.mean(past)
    return float(np.clip(bias, -settings.max_bias, settings.max_bias))


def _action(delta: np.ndarray) -> PoseAction:
    return PoseAction.from_delta(torch.from_numpy(delta))
