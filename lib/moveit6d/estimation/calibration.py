"""What a policy gets wrong about one object, read where its pose is known.

A mesh is hardly ever exactly as large as the object in its pictures, given the camera file; and a
network sees an object a little too large or too small, on the same side in every frame: its mesh's
colours, its camera and its light are not quite those of the training. Depth suffers most. Never
changes a pose.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from ..actions import PoseAction, pose_delta
from ..config import ActionMode, TrackerConfig
from ..policies import Policy, mode_of
from ..rendering.renderer import Renderer
from .refine import refine_starts
from .results import Start

SAME_SIZE = 5e-4  # a twentieth of a pixel


@dataclass(frozen=True)
class DepthUpdates:
    """Where updates from starts around an exact pose lead, one value a start.

    `units` of t_z past the exact pose, `nearer` the logarithm of the factor by which they are
    nearer than it.
    """

    units: NDArray[np.float64]
    nearer: NDArray[np.float64]

    def agreement(self, disagreement: float) -> float:
        """How much one frame says of later ones, in [0, 1].

        Of slender objects the depth that comes out depends on where the update started.
        """
        return float(1 / (1 + (self.units.std() / disagreement) ** 2))


def seen_size(
    exact: Start, policy: Policy, renderer: Renderer, config: TrackerConfig, target: int = 0
) -> float:
    """How many times as large as its mesh the object looks to the policy, in later frames, too.

    Read at a start whose pose is exact, for the policy one of the target with this number. 1 in
    mode single, which has no delta to read it from, and without the fine stage. A mesh of that size
    makes the policy, the contour and the search agree with the exact pose: as the depth that it
    reads follows a mesh's size by a part of it alone, that is more than it says of the mesh given.
    """
    settings = config.calibration
    first = _depth_updates(exact, policy, renderer, config, target)
    if first is None:
        return 1.0
    nearer = float(first.nearer.mean())
    if abs(nearer) < SAME_SIZE:
        return 1.0
    larger = replace(exact, mesh=exact.mesh.scaled(float(np.exp(nearer))))
    second = _depth_updates(larger, policy, renderer, config, target)
    if second is None:
        return 1.0
    gain = 1 - float(second.nearer.mean()) / nearer
    if gain < settings.least_gain:
        return 1.0
    most = np.log1p(settings.max_size)
    size = np.clip(nearer / gain, -most, most)
    share = settings.size_share * first.agreement(settings.size_disagreement)
    return float(np.exp(share * size))


def depth_bias(
    exact: Start, policy: Policy, renderer: Renderer, config: TrackerConfig, target: int = 0
) -> float:
    """By how many units of t_z the policy's updates will lead past the object in later frames.

    Read as `seen_size`; 0 where that is 1 without looking.
    """
    settings = config.calibration
    updates = _depth_updates(exact, policy, renderer, config, target)
    if updates is None:
        return 0.0
    bias = settings.share * updates.agreement(settings.disagreement) * updates.units.mean()
    return float(np.clip(bias, -settings.max_bias, settings.max_bias))


def _depth_updates(
    exact: Start, policy: Policy, renderer: Renderer, config: TrackerConfig, target: int
) -> DepthUpdates | None:
    """One update each from starts around the pose; None where no update can be read."""
    settings, loop = config.calibration, config.loop
    if mode_of(policy, loop.mode) is ActionMode.SINGLE or not loop.fine_stage:
        return None
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
    if not ends:
        return None
    units = [float(pose_delta(exact.centred, end, diameter / loop.fine_scale)[2]) for end in ends]
    distance = exact.centred.translation.norm()
    nearer = [float(torch.log(distance / end.translation.norm())) for end in ends]
    return DepthUpdates(np.array(units), np.array(nearer))


def _action(delta: np.ndarray) -> PoseAction:
    return PoseAction.from_delta(torch.from_numpy(delta))
