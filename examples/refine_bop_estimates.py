"""Refine the pose estimates of any method on a data set in BOP's layout.

    python examples/refine_bop_estimates.py --output out/bop
    python examples/refine_bop_estimates.py --dataset lmo --split test --estimates poses.csv \\
        --output out/bop

The first line makes a small data set and estimates that are off by about 2 cm and 9 degrees. On
the command line: `moveit6d refine` and `moveit6d evaluate bop`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch

from moveit6d import InputError, Pose, load_policy, make_renderer
from moveit6d.datasets.bop import (
    BopDataset,
    Estimate,
    Instance,
    by_image,
    read_results,
    write_results,
)
from moveit6d.datasets.bop_writer import BopImage, write_bop
from moveit6d.estimation import Target, refine_single
from moveit6d.evaluation.bop.add_recall import results_table, score_results, targets_of
from moveit6d.geometry.rotation import exp_so3
from moveit6d.synthesis.objects.demo_object import demo_object
from moveit6d.synthesis.sequences.sequence import Scene


def main(arguments: Sequence[str] | None = None) -> None:
    """Make or read the data, refine image by image, score before and after."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--dataset", type=Path, help="folder in BOP's layout; none: made here")
    parser.add_argument("--split", default="test", help="folder in it")
    parser.add_argument("--estimates", type=Path, help="BOP result file with the poses to refine")
    parser.add_argument("--output", type=Path, default=Path("out/bop"), help="for the results")
    parser.add_argument("--images", type=int, default=10, help="images that are made")
    parser.add_argument("--weights", type=Path, help="weights file instead of the shipped one")
    args = parser.parse_args(arguments)
    if (args.dataset is None) != (args.estimates is None):
        raise InputError("give --dataset and --estimates, or neither.")

    if args.dataset is None:
        print("Making a small data set …")
        args.dataset, args.estimates = args.output / "made", args.output / "initial.csv"
        make_data(args.dataset, args.split, args.images)
        write_results(args.estimates, disturbed(BopDataset(args.dataset, args.split)))

    dataset = BopDataset(args.dataset, args.split)
    initial = read_results(args.estimates)
    policy, renderer = load_policy(args.weights), make_renderer()

    # All poses of an image go through the network together.
    refined = list(initial)
    for (scene, number), rows in by_image(initial):
        image = dataset.image(scene, number)
        camera = dataset.camera(scene, number, (image.shape[1], image.shape[0]))
        targets = [
            Target(image, camera, dataset.mesh(initial[row].object), initial[row].pose)
            for row in rows
        ]
        for row, result in zip(
            rows, refine_single(targets, policy=policy, renderer=renderer), strict=True
        ):
            pose = initial[row].pose if result.pose is None else result.pose
            refined[row] = replace(initial[row], pose=pose, score=result.confidence)
    write_results(args.output / "refined.csv", refined)

    goals = targets_of(initial, dataset)
    scores = [
        (name, score_results(dataset, estimates, goals))
        for name, estimates in (("before", initial), ("after", refined))
    ]
    print(results_table(scores))
    print(f"Written: {args.output / 'refined.csv'}")


def make_data(root: Path, split: str, count: int) -> None:
    """Images of a toy robot with true poses, in BOP's layout."""
    robot = demo_object()
    scene = Scene(robot, seed=3, frames=max(2, count), difficulty="medium")

    def images() -> Iterator[BopImage]:
        for number in range(count):
            rendered = scene.render_frame(number)
            truth = [Instance(1, rendered.pose, rendered.visible_fraction)]
            yield BopImage(1, number, rendered.image, scene.camera, truth)

    write_bop(root, split, {1: robot}, images())


def disturbed(dataset: BopDataset) -> list[Estimate]:
    """The true poses, moved and turned at random: what a detector might have said."""
    random = np.random.default_rng(0)
    found = []
    for scene in dataset.scenes():
        for image in dataset.images(scene):
            for one in dataset.truth(scene, image):
                turn = exp_so3(torch.from_numpy(np.deg2rad(random.normal(0, 5, 3))))
                shift = torch.from_numpy(random.normal(0, 0.012, 3))
                pose = Pose(turn @ one.pose.rotation, one.pose.translation + shift)
                found.append(Estimate(scene, image, one.object, 1.0, pose))
    return found


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        sys.exit(f"refine_bop_estimates: {error}")
