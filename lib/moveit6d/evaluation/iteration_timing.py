"""Times the parts of one iteration: crop, render, observe, network, move.

Never judges poses. Each part is called as the loop calls it; `whole` is the loop itself, limited to
one iteration, so that what the parts leave out shows.
"""

from __future__ import annotations

import itertools
import time
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import torch

from ..config import LoopConfig
from ..estimation import Target, refine_batch
from ..frame import prepare_frame
from ..geometry.crop import crop_patch, view_of
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.rotation import exp_so3
from ..observation import assemble
from ..policies import LoopState, Policy, to_action
from ..rendering.renderer import Renderer
from ..synthesis.default_camera import CAMERA

ONCE = LoopConfig(max_iterations=1)
PARTS = ("crop", "render", "observe", "network", "move")
WARM_UP = 5


@dataclass(frozen=True)
class IterationTimes:
    """Median milliseconds of each of `PARTS`, of their sum, and of one whole iteration."""

    parts: dict[str, float]
    total: float
    whole: float


def time_iteration(
    mesh: Mesh,
    policy: Policy,
    renderer: Renderer,
    rounds: Iterable[object],
) -> IterationTimes:
    """Time iterations on one object, seen from another side each time, in a frame of 640 × 480.

    One iteration a round; the first `WARM_UP` rounds are not counted.
    """
    random = np.random.default_rng(0)
    image = random.integers(0, 256, (CAMERA.height, CAMERA.width, 3), np.uint8)
    frame = prepare_frame(image, CAMERA)
    taken: list[list[float]] = []
    wholes: list[float] = []
    for _ in rounds:
        turn = exp_so3(torch.from_numpy(random.normal(size=3)))
        depth = 3.0 * mesh.sphere_diameter
        place = torch.tensor([0.1 * depth, -0.05 * depth, depth], dtype=torch.float64)
        centred = Pose(turn[None], place[None])
        taken.append(_time_parts(mesh, centred, frame.pixels, policy, renderer))
        begin = time.perf_counter()
        target = Target(frame, CAMERA, mesh, mesh.outer(centred[0]))
        refine_batch([target], policy=policy, renderer=renderer, loop=ONCE)
        wholes.append(1e3 * (time.perf_counter() - begin))
    table = np.array(taken[WARM_UP:])
    medians = dict(zip(PARTS, np.median(table, 0).tolist(), strict=True))
    total = float(np.median(table.sum(1)))
    return IterationTimes(medians, total, float(np.median(wholes[WARM_UP:])))


@torch.inference_mode()  # as the loop's own iterations
def _time_parts(
    mesh: Mesh, pose: Pose, pixels: torch.Tensor, policy: Policy, renderer: Renderer
) -> list[float]:
    """Milliseconds of the parts of one iteration, in the order of `PARTS`."""
    diameter = torch.tensor([mesh.sphere_diameter], dtype=torch.float64)
    moments = [time.perf_counter()]
    view = view_of(pose, diameter, policy.crop)
    patch = crop_patch(pixels, view[0], CAMERA.matrix)
    moments.append(time.perf_counter())
    gbuffer = renderer.render([mesh], view.to_virtual(pose), view.intrinsics)
    moments.append(time.perf_counter())
    seen = assemble(patch[None], gbuffer, view, diameter)
    moments.append(time.perf_counter())
    prediction = policy.predict(seen, LoopState(pose, diameter, torch.arange(1)))
    moments.append(time.perf_counter())
    to_action(prediction, policy.mode).apply_centred(pose, diameter, policy.crop)
    moments.append(time.perf_counter())
    return [1e3 * (end - start) for start, end in itertools.pairwise(moments)]
