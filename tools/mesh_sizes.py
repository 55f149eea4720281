"""How well is an object followed whose mesh is a little too large or too small?

    .venv/bin/python -m tools.mesh_sizes SEQUENCES [--deviation 0.02]

Tracks every sequence from its exact first pose, from which the tracker calibrates, with its mesh
larger or smaller about its middle by a factor that is spread over the sequences as a normal
distribution with this standard deviation. Means over the sequences of the frames with ADD(-S) below
10, 5 and 2 % of the diameter. Scans, printed objects, focal lengths: sizes hardly ever fit exactly.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import norm

from moveit6d.config import CalibrationConfig, TrackerConfig
from moveit6d.datasets import open_dataset
from moveit6d.datasets.sequences import Sequence
from moveit6d.estimation import PoseTracker
from moveit6d.evaluation.metrics import add_s
from moveit6d.evaluation.tables import markdown
from moveit6d.evaluation.track_scores import EvaluationPoints
from moveit6d.policies import Policy, load_policy
from tools.true_frames import true_frames

LIMITS = (0.1, 0.05, 0.02)  # of the diameter
HEAD = ["sequence", "size of the mesh", "of which seen", "< 10 %", "< 5 %", "< 2 %"]


def main() -> None:
    """Print a row a sequence, and one of all."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("sequences", type=Path)
    parser.add_argument("--deviation", type=float, default=0.02, help="of the size, 0.02 is 2 %%")
    usual = CalibrationConfig()
    for name in ("share", "size_share"):
        help_text = f"`calibration.{name}`"
        parser.add_argument(f"--{name}", type=float, default=getattr(usual, name), help=help_text)
    parser.add_argument("--no_calibration", action="store_true")
    args = parser.parse_args()
    torch.set_num_threads(1)
    settings = CalibrationConfig(
        enabled=not args.no_calibration, share=args.share, size_share=args.size_share
    )
    policy, config = load_policy(), TrackerConfig(calibration=settings)
    rows, shares = [], []
    sequences = list(open_dataset(args.sequences, None))
    for sequence, size in zip(sequences, sizes(len(sequences), args.deviation), strict=True):
        errors, seen = errors_of(sequence, size, policy, config)
        shares.append([100 * np.mean(errors < limit) for limit in LIMITS])
        rows.append(_row(sequence.name, f"{size:.3f}", f"{seen:.3f}", shares[-1]))
    print(markdown(HEAD, [*rows, _row("all", "", "", np.mean(shares, axis=0))]))


def sizes(count: int, deviation: float) -> NDArray[np.float64]:
    """Factors with this standard deviation around 1, the same ones each time, in no order."""
    quantiles = (np.random.default_rng(5).permutation(count) + 0.5) / count
    return np.asarray(1 + deviation * norm.ppf(quantiles))


def errors_of(
    sequence: Sequence, size: float, policy: Policy, config: TrackerConfig
) -> tuple[NDArray[np.float64], float]:
    """ADD(-S) of each frame after the first, diameters, infinite where there is no pose.

    And how many times as large as its mesh the tracker took the object to be.
    """
    mesh, errors = sequence.load_mesh(), []
    surface = EvaluationPoints.of(mesh, symmetric=sequence.symmetric)
    tracker: PoseTracker | None = None
    for frame, truth in true_frames(sequence, 1):
        if tracker is None:
            tracker = PoseTracker(
                mesh.scaled(size), frame.camera, truth, policy=policy, config=config
            )
            if config.calibration.enabled:
                tracker.calibrate(frame)
            continue
        pose = tracker.update(frame).pose
        error = np.inf
        if pose is not None:
            error = float(add_s(pose, truth, surface.points, sequence.symmetric))
        errors.append(error / surface.diameter)
    return np.array(errors), 1.0 if tracker is None else tracker.tracks[0].size


def _row(name: str, size: str, seen: str, shares: list[float] | NDArray[np.float64]) -> list[str]:
    return [name, size, seen, *(f"{share:.1f}" for share in shares)]


if __name__ == "__main__":
    main()
