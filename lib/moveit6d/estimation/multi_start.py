"""Looking around: other starts where the network does not believe its end.

Never touches a pose that is sure, and never looks farther than starts usually err.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from ..geometry.visibility import why_unseen
from ..policies import ActionMode, Policy
from ..rendering.renderer import Renderer
from .refine import Target, TrackingResult, refine_batch
from .track_state import HIGH_CONFIDENCE, PerturbationConfig, sample_perturbation

BATCH = 32  # starts at once: memory


# Where else to start, around the given pose and around the one that was come to, and how often.
AROUND_START = PerturbationConfig(6, (15.0, 15.0, 8.0), (5.0, 20.0))
AROUND_RESULT = PerturbationConfig(4, (3.0, 3.0, 3.0), (2.0, 6.0), fine=True)
ROUNDS = 2


def refine_multi_start(
    targets: Sequence[Target],
    *,
    policy: Policy,
    renderer: Renderer,
    max_iterations: int | None = None,
) -> list[TrackingResult]:
    """`refine_batch` for single images, and a search for every target whose end is in doubt."""
    results = refine_batch(targets, policy=policy, renderer=renderer, max_iterations=max_iterations)
    if not supports_multi_start(policy):
        return results
    random = [np.random.default_rng(0) for _ in targets]
    for _ in range(ROUNDS):
        others = [
            _others(*one) if one[1].confidence < HIGH_CONFIDENCE else []
            for one in zip(targets, results, random, strict=True)
        ]
        results = most_confident(
            results, others, policy=policy, renderer=renderer, max_iterations=max_iterations
        )
    return results


def supports_multi_start(policy: Policy) -> bool:
    """Whether a policy looks around at all; one of single actions, the paper's, does not."""
    return policy.mode is not ActionMode.SINGLE


def most_confident(
    results: Sequence[TrackingResult],
    others: Sequence[Sequence[Target]],
    *,
    policy: Policy,
    renderer: Renderer,
    max_iterations: int | None = None,
) -> list[TrackingResult]:
    """Each result, or where one of its other starts ends if the policy believes that more.

    `steps` are those of the loop that ended there; `milliseconds` include the others' loops.
    """
    begin = time.perf_counter()
    found = list(results)
    starts = [(i, target) for i, some in enumerate(others) for target in some]
    for first in range(0, len(starts), BATCH):
        owners, targets = zip(*starts[first : first + BATCH], strict=True)
        ends = refine_batch(
            targets, policy=policy, renderer=renderer, max_iterations=max_iterations
        )
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
    others = list(perturbed_targets(target, AROUND_START, random))
    if result.pose is not None:
        others += perturbed_targets(replace(target, pose=result.pose), AROUND_RESULT, random)
    return others


def perturbed_targets(
    target: Target, config: PerturbationConfig, random: np.random.Generator
) -> Iterator[Target]:
    """The target from places around its pose, as far as the camera can see the object there."""
    mesh = target.mesh
    for _ in range(config.count):
        pose = sample_perturbation(mesh, target.pose, random, config)
        if why_unseen(mesh.inner(pose), mesh, target.camera) is None:
            yield replace(target, pose=pose, fine=config.fine)
