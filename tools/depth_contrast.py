"""At which distance does the outline fit the pictures best, the true one or another?

    .venv/bin/python -m tools.depth_contrast SEQUENCES [--every N]

Moves the true pose of every Nth frame along its viewing ray and takes the contrast across the
outline there (`contour_contrast`). The best factor of the distance is 1 where mesh, camera and true
poses agree with the pictures; elsewhere no tracker that looks at the pictures alone can be right in
depth. Never used to move or to choose a pose.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from moveit6d.datasets import open_dataset
from moveit6d.datasets.sequences import Sequence
from moveit6d.evaluation.tables import markdown
from moveit6d.geometry.crop import look_at
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from moveit6d.rendering.renderer import Renderer
from tools.contour_contrast import contrast
from tools.true_frames import true_frames

FACTORS = np.arange(0.94, 1.0601, 0.005)


def main() -> None:
    """Print a row a sequence."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("sequences", type=Path)
    parser.add_argument("--every", type=int, default=20, help="frames between those looked at")
    args = parser.parse_args()
    renderer, rows = make_renderer(), []
    for sequence in open_dataset(args.sequences, None):
        best = best_factors(sequence, args.every, renderer)
        low, middle, high = (f"{value:.3f}" for value in np.percentile(best, (25, 50, 75)))
        rows.append([sequence.name, str(len(best)), middle, f"{low} to {high}"])
    print(markdown(["sequence", "frames", "best factor (median)", "quartiles"], rows))


def best_factors(sequence: Sequence, every: int, renderer: Renderer) -> NDArray[np.float64]:
    """The factor of the true distance with the most contrast, frame by frame."""
    mesh, found = sequence.load_mesh(), []
    diameter = torch.tensor(mesh.sphere_diameter).double()
    for frame, truth in true_frames(sequence, every):
        centred = mesh.inner(truth)
        view = look_at(centred, diameter)
        values = [
            contrast(
                frame,
                mesh,
                mesh.outer(Pose(centred.rotation, factor * centred.translation)),
                view,
                renderer,
            )
            for factor in FACTORS
        ]
        found.append(FACTORS[int(np.argmax(values))])
    return np.array(found)


if __name__ == "__main__":
    main()
