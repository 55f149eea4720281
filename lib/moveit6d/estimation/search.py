"""Looking around: other starts for an object whose pose the network does not believe.

Never touches a pose that is believed, and never looks farther than starts usually err.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from ..actions import PoseAction
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import MoveMode, Policy
from ..rendering.renderer import Renderer
from .loop import Target, TrackingResult, out_of_sight, refine_batch

BATCH = 32  # starts at once: memory


@dataclass(frozen=True)
class Around:
    """Places at random around a pose: how many, how far away, and whether to look closely at once.

    `shift` are the most counts aside, up or down, nearer or farther; `turn` the degrees from, to.
    """

    count: int
    shift: tuple[float, float, float]
    turn: tuple[float, float]
    close: bool = False


# Of a single image: confidence from which a pose is believed; where else to start, around the given
# pose and around the one that was come to; and how often.
BELIEVED = 0.65
GIVEN = Around(6, (15.0, 15.0, 8.0), (5.0, 20.0))
FOUND = Around(4, (3.0, 3.0, 3.0), (2.0, 6.0), close=True)
ROUNDS = 2


def refine_or_search(
    targets: Sequence[Target], *, policy: Policy, renderer: Renderer, max_steps: int | None = None
) -> list[TrackingResult]:
    """`refine_batch` for single images, and a search for every target whose end is in doubt.

    A policy of single actions does not search: it is the paper's, as it stands there.
    """
    results = refine_batch(targets, policy=policy, renderer=renderer, max_steps=max_steps)
    if policy.mode is MoveMode.SINGLE:
        return results
    random = [np.random.default_rng(0) for _ in targets]
    for _ in range(ROUNDS):
        others = [
            _others(*one) if one[1].confidence < BELIEVED else []
            for one in zip(targets, results, random, strict=True)
        ]
        results = surest(results, others, policy=policy, renderer=renderer, max_steps=max_steps)
    return results


def surest(
    results: Sequence[TrackingResult],
    others: Sequence[Sequence[Target]],
    *,
    policy: Policy,
    renderer: Renderer,
    max_steps: int | None = None,
) -> list[TrackingResult]:
    """Each result, or where one of its other starts ends if the policy believes that more.

    `steps` are those of the loop that ended there; `milliseconds` include the others' loops.
    """
    begin = time.perf_counter()
    found = list(results)
    starts = [(i, target) for i, some in enumerate(others) for target in some]
    for first in range(0, len(starts), BATCH):
        owners, targets = zip(*starts[first : first + BATCH], strict=True)
        ends = refine_batch(targets, policy=policy, renderer=renderer, max_steps=max_steps)
        for i, end in zip(owners, ends, strict=True):
            if end.pose is not None and end.confidence > found[i].confidence:
                found[i] = end
    spent = (time.perf_counter() - begin) * 1e3
    return [
        replace(now, milliseconds=before.milliseconds + spent) if some else now
        for now, before, some in zip(found, results, others, strict=True)
    ]


def _others(target: Target, result: TrackingResult, random: np.random.Generator) -> list[Target]:
    """Other starts for a target in a single image."""
    others = list(places(target, GIVEN, random))
    if result.pose is not None:
        others += places(replace(target, pose=result.pose), FOUND, random)
    return others


def places(target: Target, around: Around, random: np.random.Generator) -> Iterator[Target]:
    """The target from places around its pose, as far as the camera can see the object there."""
    mesh = target.mesh
    for _ in range(around.count):
        pose = beside(mesh, target.pose, random, around)
        if out_of_sight(mesh.inner(pose).translation, mesh.sphere_diameter, target.camera) is None:
            yield replace(target, pose=pose, close=around.close)


def beside(mesh: Mesh, pose: Pose, random: np.random.Generator, around: Around) -> Pose:
    """A pose at random around another one; both in the mesh file's frame."""
    axis = random.normal(size=3)
    axis *= random.uniform(*around.turn) / np.linalg.norm(axis)
    counts = torch.from_numpy(np.concatenate([random.uniform(-1, 1, 3) * around.shift, axis]))
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    centred = mesh.inner(pose.to(torch.float64))
    return mesh.outer(PoseAction.of(counts).apply(centred, diameter))
