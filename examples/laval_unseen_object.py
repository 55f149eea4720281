"""From the first frame of a Laval-format folder to a report, for an object never trained on.

    python examples/laval_unseen_object.py --output out/laval
    python examples/laval_unseen_object.py --laval DATA --sequence dog_occlusion_h_30 --output out

The first line makes a small surrogate for the data set: a toy robot behind a board that hides
30 % of it. On the command line: `moveit6d benchmark tracking --sequences DATA --report out`.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from moveit6d import InputError, PoseTracker, load_policy, make_renderer
from moveit6d.datasets.catalog import open_dataset, surrogate
from moveit6d.datasets.pose_files import PoseRow
from moveit6d.evaluation.track_scores import EvaluationPoints, frame_errors, score
from moveit6d.synthesis.objects.demo_object import demo_object
from moveit6d.synthesis.sequences.surrogate_datasets import GenerationOptions, write_laval_surrogate
from moveit6d.visualization.report import Run, write_report


def main(arguments: Sequence[str] | None = None) -> None:
    """Make or read the data, follow the object, score, report."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--laval", type=Path, help="folder in Laval's format; none: made here")
    parser.add_argument("--sequence", help="name of a sequence in it; none: the last one")
    parser.add_argument("--output", type=Path, default=Path("out/laval"), help="for the results")
    parser.add_argument("--frames", type=int, default=60, help="frames at most")
    parser.add_argument("--weights", type=Path, help="weights file instead of the shipped one")
    args = parser.parse_args(arguments)

    # The data: sequences of any format look the same from here on.
    folder = args.laval or args.output / "data"
    if args.laval is None:
        print("Making a surrogate for Laval …")
        write_laval_surrogate(
            folder, {"robot": demo_object()}, GenerationOptions(args.frames), [30]
        )
    found = {sequence.name: sequence for sequence in open_dataset(folder, "laval")}
    name = args.sequence or list(found)[-1]
    if name not in found:
        raise InputError(f"{folder} has no sequence {name}; it has {', '.join(found)}.")
    sequence = found[name]

    # The tracker: it gets the mesh, the camera and the first pose, and no other true pose.
    mesh, renderer = sequence.load_mesh(), make_renderer()
    policy = load_policy(args.weights)
    tracker = PoseTracker(mesh, sequence.camera, sequence.start, policy=policy, renderer=renderer)
    rows = {sequence.first: PoseRow(sequence.first, pose=sequence.start)}
    for frame in islice(sequence.open(), sequence.first + 1, args.frames):
        result = tracker.update(frame.image)
        rows[frame.index] = PoseRow(
            frame.index,
            frame.name,
            result.pose,
            result.iterations,
            result.stopped_by.value,
            result.confidence,
            result.milliseconds,
        )

    # The score: against the true poses of the frames that were followed.
    truth = {number: pose for number, pose in sequence.truth.items() if number in rows}
    surface = EvaluationPoints.of(mesh, symmetric=sequence.symmetric)
    result_score = score(rows, truth, surface)
    verdict = (
        f"{name}: ADD below 10 % of the diameter in {100 * result_score.below_10:.1f} % of "
        f"{result_score.frames} frames, mean {1000 * result_score.mean_add:.1f} mm"
    )
    print(verdict)

    # The report: one HTML page.
    errors = {error.frame: error for error in frame_errors(rows, truth, surface)}
    run = Run(
        title=name,
        verdict=verdict,
        mesh=mesh,
        camera=sequence.camera,
        frames=sequence.open(),
        rows=rows,
        truth=truth,
        errors=errors,
        facts={"data": f"{folder} {surrogate(folder)}", "weights": policy.source},
    )
    write_report(args.output / "report.html", run, renderer)
    print(f"Look at {args.output / 'report.html'}")


if __name__ == "__main__":
    try:
        main()
    except InputError as error:
        sys.exit(f"laval_unseen_object: {error}")
