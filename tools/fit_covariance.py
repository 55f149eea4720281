"""How far off poses are, beside what their covariance says.

    .venv/bin/python -m tools.fit_covariance SEQUENCES [SEQUENCES ...] [--weights FILE] [--every N]

Refines every Nth frame of sequences as a tracker does, but without contour, calibration and search,
from its true pose and from two starts a few units off. The errors are compared with their
covariances along the six axes of each of these, in action units. `LoopConfig.displacement_error`
is what makes both alike in the middle of the table.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from moveit6d import Mesh, PoseAction
from moveit6d.config import LoopConfig
from moveit6d.datasets import open_dataset
from moveit6d.datasets.sequences import Sequence
from moveit6d.errors import InputError
from moveit6d.estimation.covariance import update_jacobian
from moveit6d.estimation.refine import refine_starts
from moveit6d.estimation.results import Start
from moveit6d.evaluation.tables import markdown
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import log_so3
from moveit6d.policies import SHIPPED_WEIGHTS, Policy, load_policy
from moveit6d.rendering.backends import make_renderer
from moveit6d.rendering.renderer import Renderer
from tools.true_frames import true_frames

HEAD = ["standard deviations", "poses' axes", "error, robust", "within 1", "within 2 of them"]
OFF = np.array([2.0, 2.0, 3.0, 5.0, 5.0, 4.0])  # action units, of starts beside the true pose
STARTS = 2
BINS = 8
ROBUST = 1.4826  # times the median of absolute values: the standard deviation of normal ones


def main(arguments: list[str] | None = None) -> int:
    """Print a row for each range of standard deviations, and the factor that fits them best."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("sequences", type=Path, nargs="+")
    parser.add_argument("--weights", type=Path, default=SHIPPED_WEIGHTS)
    parser.add_argument("--every", type=int, default=4, help="frames between those looked at")
    args = parser.parse_args(arguments)
    torch.set_num_threads(1)
    policy, renderer = load_policy(args.weights), make_renderer()
    found = [
        axis
        for folder in args.sequences
        for sequence in open_dataset(folder, None)
        if not sequence.symmetric
        for axis in axes_of(sequence, args.every, policy, renderer)
    ]
    if not found:
        raise InputError("There are no examples: no sequence has a pose with a covariance.")
    print(report(np.array(found)))
    return 0


def axes_of(
    sequence: Sequence, every: int, policy: Policy, renderer: Renderer
) -> Iterator[tuple[float, float]]:
    """Of every pose six standard deviations, as its covariance says, each with the error there."""
    mesh, random = sequence.load_mesh(), np.random.default_rng(0)
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    for frame, truth in true_frames(sequence, every):
        centred = mesh.inner(truth)
        near = [
            PoseAction.from_delta(torch.from_numpy(random.normal(size=6) * OFF))
            for _ in range(STARTS)
        ]
        poses = [centred, *(action.apply_centred(centred, diameter) for action in near)]
        starts = [Start(frame, mesh, pose) for pose in poses]
        for end in refine_starts(starts, policy=policy, renderer=renderer, loop=LoopConfig()):
            result = end.result(mesh)
            if result.pose is not None and result.covariance is not None:
                yield from along_axes(result.pose, result.covariance, truth, mesh)


def along_axes(
    pose: Pose, covariance: Tensor, truth: Pose, mesh: Mesh
) -> list[tuple[float, float]]:
    """Standard deviations and errors of one pose, mesh file's frame, in action units."""
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    units = torch.linalg.inv(update_jacobian(mesh.inner(pose), mesh, diameter, "look_at"))
    turn = log_so3(truth.rotation @ pose.rotation.mT)
    error = units @ torch.cat([truth.translation - pose.translation, turn])
    variances, axes = torch.linalg.eigh(units @ covariance @ units.mT)
    deviations = variances.clamp_min(0).sqrt().tolist()
    return list(zip(deviations, (axes.mT @ error).tolist(), strict=True))


def report(found: NDArray[np.float64]) -> str:
    """The table of (N, 2) standard deviations and errors, and what would fit them."""
    order = np.argsort(found[:, 0], kind="stable")
    rows, factors = [], []
    for part in np.array_split(found[order], BINS):
        said, error = part.T
        actual = ROBUST * float(np.median(np.abs(error)))
        factors.append(actual / float(np.median(said)))
        shares = [f"{100 * np.mean(np.abs(error) < k * said):.0f} %" for k in (1, 2)]
        span = f"{said[0]:.2f} to {said[-1]:.2f}"
        rows.append([span, str(len(part)), f"{actual:.2f}", *shares])
    used = LoopConfig().displacement_error
    fitted = used * float(np.median(factors))
    return f"{markdown(HEAD, rows)}\n\ndisplacement_error: {used} now, {fitted:.2f} fits best"


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"fit_covariance: {error}")
