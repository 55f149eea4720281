"""Proof of the loop: with a policy that knows the truth, every start must end at it.

Never uses weights. What remains is geometry, rendering and the stop rules.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
import torch

from ..actions import PoseAction, pose_delta
from ..config import ActionMode, LoopConfig
from ..estimation import Target, refine_batch
from ..geometry.mesh import Mesh, sphere_diameters
from ..geometry.pose import Pose
from ..geometry.rotation import random_rotations
from ..policies import OraclePolicy
from ..rendering.renderer import Renderer
from ..synthesis.default_camera import CAMERA
from ..synthesis.training.clusters import ClusterConfig, draw_delta

LOOP = LoopConfig(max_iterations=200)  # the largest start is 135 single steps away
BATCH = 25


def oracle_errors(
    meshes: Sequence[Mesh], renderer: Renderer, mode: ActionMode, starts: int, seed: int = 0
) -> Iterator[float]:
    """Largest delta left on any axis at the end of each of `starts` loops, in steps.

    Starts are drawn from the paper's five clusters, objects in turn. Infinity for a failed loop.
    """
    random = np.random.default_rng(seed)
    generator = torch.Generator().manual_seed(seed)
    image = np.full((CAMERA.height, CAMERA.width, 3), 128, np.uint8)
    for begin in range(0, starts, BATCH):
        chosen = [meshes[k % len(meshes)] for k in range(begin, min(begin + BATCH, starts))]
        diameter = sphere_diameters(chosen)
        delta = np.stack([draw_delta(random, ClusterConfig()) for _ in chosen])
        side = random.uniform([-0.8, -0.6, 3.5], [0.8, 0.6, 8.0], (len(chosen), 3))
        place = torch.from_numpy(side) * diameter[:, None]
        truth = Pose(random_rotations(len(chosen), generator), place)
        start = PoseAction.from_delta(torch.from_numpy(delta)).apply_centred(truth, diameter)
        targets = [
            Target(image, CAMERA, mesh, mesh.outer(start[i])) for i, mesh in enumerate(chosen)
        ]
        policy = OraclePolicy(truth, mode)
        results = refine_batch(targets, policy=policy, renderer=renderer, loop=LOOP)
        for i, result in enumerate(results):
            if result.pose is None:
                yield float("inf")
                continue
            left = pose_delta(chosen[i].inner(result.pose), truth[i], diameter[i])
            yield float(left.abs().max())
