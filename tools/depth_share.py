"""How much of what is wrong about poses is their depth?

    .venv/bin/python -m tools.depth_share SEQUENCES [--weights FILE] [--every N] [--scale 1.6]

Starts every Nth frame of sequences at its true pose and refines it as a tracker does, but without
contour, calibration and search; then once more with the depth of the true pose instead of what came
out. Never used to choose a pose.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from moveit6d.config import LoopConfig
from moveit6d.datasets import open_dataset
from moveit6d.datasets.sequences import Sequence
from moveit6d.estimation.refine import refine_starts
from moveit6d.estimation.results import Start
from moveit6d.evaluation.metrics import ADD_LIMIT, add_s
from moveit6d.evaluation.tables import markdown
from moveit6d.evaluation.track_scores import EvaluationPoints
from moveit6d.geometry.crop import OBJECT_SIZE
from moveit6d.geometry.pose import Pose
from moveit6d.policies import SHIPPED_WEIGHTS, Policy, load_policy
from moveit6d.rendering.backends import make_renderer
from moveit6d.rendering.renderer import Renderer
from tools.true_frames import true_frames

HEAD = ["sequence", "frames", "< 10 %", "with the true depth", "t_z off, units", "its size"]


@dataclass(frozen=True)
class Errors:
    """Of one frame: ADD(-S), the same with the true depth, diameters; t_z, units, far positive."""

    add: float
    with_depth: float
    units: float


def main() -> None:
    """Print a row a sequence, and one of all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("sequences", type=Path)
    parser.add_argument("--weights", type=Path, default=SHIPPED_WEIGHTS)
    parser.add_argument("--every", type=int, default=3, help="frames between those looked at")
    parser.add_argument("--scale", type=float, default=LoopConfig().fine_scale)
    args = parser.parse_args()
    torch.set_num_threads(1)
    policy, renderer = load_policy(args.weights), make_renderer()
    loop = LoopConfig(fine_scale=args.scale)
    rows, every = [], []
    for sequence in open_dataset(args.sequences, None):
        found = errors_of(sequence, args.every, policy, renderer, loop)
        rows.append(_row(sequence.name, found))
        every += found
    print(markdown(HEAD, [*rows, _row("all", every)]))


def errors_of(
    sequence: Sequence, every: int, policy: Policy, renderer: Renderer, loop: LoopConfig
) -> list[Errors]:
    """The errors of every `every`-th frame whose refinement has a pose."""
    mesh, found = sequence.load_mesh(), []
    surface = EvaluationPoints.of(mesh, symmetric=sequence.symmetric)
    for frame, truth in true_frames(sequence, every):
        centred = mesh.inner(truth)
        start = Start(frame, mesh, centred, fine=True)
        ended = refine_starts([start], policy=policy, renderer=renderer, loop=loop)[0].centred
        if ended is None:
            continue
        distance, true_distance = ended.translation.norm(), centred.translation.norm()
        corrected = Pose(ended.rotation, ended.translation * (true_distance / distance))
        errors = [
            float(add_s(mesh.outer(pose), truth, surface.points, sequence.symmetric))
            for pose in (ended, corrected)
        ]
        add, with_depth = (error / surface.diameter for error in errors)
        units = OBJECT_SIZE * float(distance / true_distance - 1)
        found.append(Errors(add, with_depth, units))
    return found


def _row(name: str, errors: list[Errors]) -> list[str]:
    add, with_depth, units = (
        np.array([getattr(one, part) for one in errors]) for part in ("add", "with_depth", "units")
    )
    shares = [f"{100 * np.mean(part < ADD_LIMIT):.1f}" for part in (add, with_depth)]
    size = f"{np.abs(units).mean():.2f}"
    return [name, str(len(errors)), *shares, f"{units.mean():+.2f}", size]


if __name__ == "__main__":
    main()
