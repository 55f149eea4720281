"""Multi-start refinement: other starts where the confidence is low.

Never replaces a result by a less confident one.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import torch

from ..actions import PoseAction
from ..config import ActionMode, PerturbationConfig, TrackerConfig
from ..frame import Frame
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..policies import Policy, mode_of
from ..rendering.renderer import Renderer
from .refine import refine_starts
from .results import Refined, Start
from .track_state import TrackState


def refine_multi_start(
    starts: Sequence[Start], *, policy: Policy, renderer: Renderer, config: TrackerConfig
) -> list[Refined]:
    """The loop for single images, and perturbed starts for results of low confidence."""
    results = refine_starts(starts, policy=policy, renderer=renderer, loop=config.loop)
    if not uses_multi_start(policy, config):
        return results
    random = [np.random.default_rng(0) for _ in starts]
    for _ in range(config.multi_start.rounds):
        others = [
            _others(start, result, generator, config)
            if result.confidence < config.multi_start.below
            else []
            for start, result, generator in zip(starts, results, random, strict=True)
        ]
        results = most_confident(results, others, policy=policy, renderer=renderer, config=config)
    return results


def uses_multi_start(policy: Policy, config: TrackerConfig) -> bool:
    """Whether other starts are tried at all; the paper's single actions do without."""
    mode = mode_of(policy, config.loop.mode)
    return config.multi_start.enabled and mode is not ActionMode.SINGLE


def most_confident(
    results: Sequence[Refined],
    others: Sequence[Sequence[Start]],
    *,
    policy: Policy,
    renderer: Renderer,
    config: TrackerConfig,
    race: bool = False,
    targets: Sequence[int] | None = None,
) -> list[Refined]:
    """Each result, or that of one of its other starts if it is more confident.

    `targets` are the numbers by which the policy knows the results' objects (`LoopState.target`);
    those of the results if None. With `race` only the most confident of the other starts goes on
    after one iteration. `iterations` are those of the loop that ended there; `milliseconds` include
    the others' loops.
    """
    begin = time.perf_counter()
    found = list(results)
    known = range(len(results)) if targets is None else targets
    for part in _batches(others, config.multi_start.batch_size, race):
        owners = [i for i, _ in part]
        ends = refine_starts(
            [start for _, start in part],
            policy=policy,
            renderer=renderer,
            loop=config.loop,
            groups=owners if race else None,
            targets=[known[i] for i in owners],
        )
        for i, end in zip(dict.fromkeys(owners) if race else owners, ends, strict=True):
            if end.centred is not None and end.confidence > found[i].confidence:
                found[i] = end
    spent = (time.perf_counter() - begin) * 1e3
    return [
        replace(now, milliseconds=before.milliseconds + spent) if some else now
        for now, before, some in zip(found, results, others, strict=True)
    ]


def _batches(
    others: Sequence[Sequence[Start]], size: int, together: bool
) -> Iterator[list[tuple[int, Start]]]:
    """The starts with the number of their result, `size` at a time.

    A batch is larger where those of one result are to be `together`.
    """
    batch: list[tuple[int, Start]] = []
    for i, some in enumerate(others):
        for start in some:
            if len(batch) >= size and not (together and batch[-1][0] == i):
                yield batch
                batch = []
            batch.append((i, start))
    if batch:
        yield batch


def _others(
    start: Start, result: Refined, random: np.random.Generator, config: TrackerConfig
) -> list[Start]:
    """Other starts in a single image."""
    if result.error is not None and result.iterations == 0:
        return []  # the given start cannot be seen
    others = perturbed_starts(start, config.multi_start.around_start, random)
    if result.centred is not None:
        here = replace(start, centred=result.centred)
        others += perturbed_starts(here, config.multi_start.around_result, random)
    return others


def start_at(frame: Frame, track: TrackState, centred: Pose) -> Start:
    """A start from another pose of a track, which shows the policy what that of the track shows."""
    return Start(frame, track.mesh, centred, track.depth_bias, keyframes=track.keyframes)


def recovery_starts(frame: Frame, track: TrackState) -> list[Start]:
    """Perturbed starts around the recovery poses of a track."""
    around = track.config.multi_start.recovery
    return [
        start
        for centred in track.recovery_poses()
        for start in perturbed_starts(start_at(frame, track, centred), around, track.random)
    ]


def perturbed_starts(
    start: Start, around: PerturbationConfig, random: np.random.Generator
) -> list[Start]:
    """Random starts around one."""
    poses = sample_perturbations(start.mesh, start.centred, random, around)
    return [replace(start, centred=pose, fine=around.fine) for pose in poses]


def sample_perturbations(
    mesh: Mesh, centred: Pose, random: np.random.Generator, around: PerturbationConfig
) -> list[Pose]:
    """Random centred poses around another one."""
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    found = []
    for _ in range(around.count):
        axis = random.normal(size=3)
        axis *= random.uniform(*around.rotation) / np.linalg.norm(axis)
        delta = np.concatenate([random.uniform(-1, 1, 3) * around.shift, axis])
        action = PoseAction.from_delta(torch.from_numpy(delta))
        found.append(action.apply_centred(centred, diameter))
    return found
