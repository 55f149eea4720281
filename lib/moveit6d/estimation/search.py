"""Single images: where the network does not believe the pose it came to, it starts from others too.

Never touches a pose that is believed, and never looks farther than starts usually err.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch

from ..actions import PoseAction
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import MoveMode, Policy
from ..rendering.renderer import Renderer
from .loop import Target, TrackingResult, out_of_sight, refine_batch

# Confidence from which a pose is believed.
BELIEVED = 0.65
# Other starts: how many lie around the given pose, and how many around where the loop ended; so
# many counts aside, up or down, nearer or farther at most, turned by so many degrees.
AROUND_START, START_SHIFT, START_TURN = 6, (15.0, 15.0, 8.0), (5.0, 20.0)
AROUND_END, END_SHIFT, END_TURN = 4, (3.0, 3.0, 3.0), (2.0, 6.0)
ROUNDS = 2  # of such starts, while the pose found so far is in doubt
BATCH = 32  # starts at once: memory


def refine_or_search(
    targets: Sequence[Target], *, policy: Policy, renderer: Renderer, max_steps: int | None = None
) -> list[TrackingResult]:
    """`refine_batch`, and again from places around for every target whose end is in doubt.

    Of all ends of a target the most confident one is its result, whose `steps` are those of its own
    loop. A policy of single actions does not search: it is the paper's, as it stands there.
    """
    begin = time.perf_counter()
    results = refine_batch(targets, policy=policy, renderer=renderer, max_steps=max_steps)
    if policy.mode is MoveMode.SINGLE:
        return results
    random = [np.random.default_rng(0) for _ in targets]
    for _ in range(ROUNDS):
        doubted = [i for i, result in enumerate(results) if result.confidence < BELIEVED]
        owners, others = [], []
        for i in doubted:
            for other in _others(targets[i], results[i], random[i]):
                owners.append(i)
                others.append(other)
        for first in range(0, len(others), BATCH):
            ends = refine_batch(
                others[first : first + BATCH], policy=policy, renderer=renderer, max_steps=max_steps
            )
            for i, end in zip(owners[first : first + BATCH], ends, strict=True):
                if end.pose is not None and end.confidence > results[i].confidence:
                    results[i] = end
        for i in doubted:
            spent = (time.perf_counter() - begin) * 1e3
            results[i] = replace(results[i], milliseconds=spent)
    return results


def _others(
    target: Target, result: TrackingResult, random: np.random.Generator
) -> Iterator[Target]:
    """Other starts for a target, as far as the camera can see the object there."""
    mesh, camera = target.mesh, target.camera
    places = [(target.pose, START_SHIFT, START_TURN, False)] * AROUND_START
    if result.pose is not None:
        places += [(result.pose, END_SHIFT, END_TURN, True)] * AROUND_END
    for pose, shift, turn, close in places:
        other = beside(mesh, pose, random, shift, turn)
        if out_of_sight(mesh.inner(other).translation, mesh.sphere_diameter, camera) is None:
            yield replace(target, pose=other, close=close)


def beside(
    mesh: Mesh, pose: Pose, random: np.random.Generator,
    shift: tuple[float, float, float], turn: tuple[float, float],
) -> Pose:  # fmt: skip
    """A pose at random beside another (mesh file's frame).

    At most `shift` counts away in x, y and depth, turned by `turn[0]` to `turn[1]` degrees.
    """
    axis = random.normal(size=3)
    axis *= random.uniform(*turn) / np.linalg.norm(axis)
    counts = torch.from_numpy(np.concatenate([random.uniform(-1, 1, 3) * shift, axis]))
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    centred = mesh.inner(pose.to(torch.float64))
    return mesh.outer(PoseAction.of(counts).apply(centred, diameter))
