"""`moveit6d evaluate`: errors of finished results against true poses.

Never tracks or refines.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .apart import check_chart, files_of_sequences, folders_of
from .common import DATASET_FORMATS, UNITS, add_verb, targets_file, use_threads
from .messages import note, progress_bar

if TYPE_CHECKING:
    from ..datasets.bop import BopDataset, Estimate
    from ..evaluation.metrics.calibration import Reliability

DESCRIPTION = """\
Prints Markdown tables.

  moveit6d evaluate tracking   tracks against sequence folders with true poses
  moveit6d evaluate bop        BOP result files against the ground truth of a split
  moveit6d evaluate ycbv       poses of YCB-Video's keyframes, as its toolbox scores them
"""

TRACKING = """\
A sequence folder has camera.json, frames/, a mesh (mesh.glb, model.glb, model.ply, metres)
and poses.csv with the true poses, perhaps with holes; other formats with --format. Results are
a folder with one <sequence>.csv (or <sequence>/poses.csv) each or, for one video, a poses.csv or
the folder that track wrote it to; of several objects by its column object. Rows that name images
belong to those, and a track that begins later is scored from there on.

columns:
  ADD<10%d, ADD<5%d  share of frames whose ADD (mean distance of 2000 surface points between
                     estimate and truth) is below 10 or 5 % of the object's diameter
  mean, median ADD   millimetres; ADD is cut at one diameter
  frames until lost  first frame from which ADD stays above 10 % for 15 frames
  5cm/5deg           share of frames within 5 cm and 5 degrees
  iterations         median of the iterations of the loop, where the results say them
  ms/frame           median of the times in the results

The first frame is the given start and is not scored; a frame without a pose is wrong. Frames
whose pose a protocol gave (stopped_by "reset") are left out, or counted with --count_resets.

--reliability NAME says how good the column `confidence` is as the probability that ADD(-S) is below
10 % of the diameter, over all scored frames with a pose, and writes the reliability diagram to
NAME.png and NAME.svg.
"""

BOP = """\
--errors add: ADD(-S) is the mean distance of up to 3000 vertices between estimate and truth,
for objects with a symmetry in models_info.json the mean distance to the nearest vertex. The
targets are the true poses of what the first file lists; one that a file lacks is wrong there,
and of an object that occurs several times in an image every instance is a target of its own.
Give the poses before and after a refinement, in this order. Score AUROC says how well the score
column tells poses below 10 % d from others: 1 perfectly, 0.5 not at all; --reliability NAME says
how good it is as a probability, too, and writes the reliability diagram to NAME.png and NAME.svg.

--errors bop19: the BOP challenge's average recall, the mean of those of VSD, MSSD and MSPD.
The targets are those of test_targets_bop19.json (or --targets, a file in the working folder or
else in the data set's), else every instance of which 10 % can be seen. VSD needs the split's depth
images; without them it is left out.
"""

YCBV = """\
--poses is an .npz file with obj_id (N), object_names, gt (N, 7) and an array (N, 7) for each
method: qw qx qy qz tx ty tz, metres, in YCB-Video's object frames; a quaternion of zeros means
no pose. --points is an .npz file with the evaluation points of each object: 01, 02, ….

columns:
  ADD, ADD-S       area under accuracy against threshold up to 10 cm, percent, one curve over
                   all rows; a row without a pose is infinitely wrong
  ADD(-S)          ADD-S for objects declared symmetric (--symmetric), ADD for the others
  mean of objects  the mean of the objects' own areas, what many papers print
  ADD-S<2cm        share of rows below 2 cm

The form "voc" is the toolbox's upper sum and reproduces published tables; "exact" is the
integral. Never compare one with the other.
"""

EXAMPLES_TRACKING = """\
examples:
  moveit6d evaluate tracking --sequences sequences --results out/ours rivals/m3t_region
  moveit6d evaluate tracking --sequences sequences/easy_00 --results out/poses.csv
"""

EXAMPLES_BOP = """\
examples:
  moveit6d evaluate bop --dataset lmo --split test --results initial.csv refined.csv
  moveit6d evaluate bop --dataset lmo --split test --errors bop19 --results refined.csv
"""

EXAMPLES_YCBV = """\
examples:
  moveit6d evaluate ycbv --poses poses.npz --points points.npz --methods posecnn
  moveit6d evaluate ycbv --poses poses.npz --points points.npz --form exact --per_object
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "evaluate", "score results against true poses", DESCRIPTION, "")
    kinds = parser.add_subparsers(title="kinds", metavar="KIND", required=True)
    _add_tracking(kinds)
    _add_bop(kinds)
    _add_ycbv(kinds)


def _add_tracking(kinds: Any) -> None:
    one = add_verb(kinds, "tracking", "score tracks through sequences", TRACKING, EXAMPLES_TRACKING)
    one.add_argument("--sequences", type=Path, required=True, metavar="DIR", help="true poses")
    one.add_argument("--format", choices=DATASET_FORMATS, help="if it is not recognised")
    one.add_argument(
        "--results", type=Path, required=True, nargs="+", metavar="PATH", help="tracks to score"
    )
    one.add_argument("--per_sequence", action="store_true", help="a row for every sequence, too")
    one.add_argument(
        "--count_resets", action="store_true", help="count frames whose pose was given, too"
    )
    _add_reliability(one)
    one.set_defaults(run=tracking)


def _add_bop(kinds: Any) -> None:
    two = add_verb(kinds, "bop", "score BOP result files", BOP, EXAMPLES_BOP)
    two.add_argument("--dataset", type=Path, required=True, metavar="DIR", help="BOP data set")
    two.add_argument("--split", required=True, metavar="NAME", help="folder in it, as test")
    two.add_argument(
        "--results", type=Path, required=True, nargs="+", metavar="FILE", help="files to score"
    )
    two.add_argument(
        "--errors",
        choices=("add", "bop19"),
        default="add",
        help="ADD(-S), or the BOP challenge's average recall",
    )
    two.add_argument("--mesh_unit", choices=UNITS, default="mm", help="unit of the models")
    two.add_argument("--targets", type=Path, metavar="FILE", help="bop19: what is to be found")
    two.add_argument(
        "--renderer",
        choices=("embree", "pyrender"),
        default="embree",
        help="bop19: draws the depths that VSD compares",
    )
    _add_reliability(two)
    two.set_defaults(run=bop)


def _add_reliability(parser: Any) -> None:
    parser.add_argument(
        "--reliability", type=Path, metavar="NAME", help="diagram of the confidence: NAME.png, .svg"
    )


def _add_ycbv(kinds: Any) -> None:
    three = add_verb(kinds, "ycbv", "score poses of YCB-Video's keyframes", YCBV, EXAMPLES_YCBV)
    three.add_argument("--poses", type=Path, required=True, metavar="FILE", help="true and found")
    three.add_argument("--points", type=Path, required=True, metavar="FILE", help="of each object")
    three.add_argument("--methods", nargs="+", default=[], metavar="NAME", help="all if not given")
    three.add_argument(
        "--symmetric",
        nargs="*",
        metavar="NAME",
        help="objects whose metric is ADD-S (default: the five of the literature)",
    )
    three.add_argument("--form", choices=("voc", "exact"), default="voc", help="of the area")
    three.add_argument("--per_object", action="store_true", help="a second table, object by object")
    three.set_defaults(run=ycbv)


def tracking(args: argparse.Namespace) -> int:
    """Print a table for each of the results."""
    from ..datasets import open_dataset
    from ..evaluation.metrics.calibration import reliability
    from ..evaluation.sequence_scores import confidences, gaps, score_tracks
    from ..evaluation.track_files import read_tracks
    from ..evaluation.track_scores import tracking_table

    sequences = open_dataset(args.sequences, args.format)
    read = files_of_sequences(sequences) if args.reliability is not None else ()
    check_chart(args, "reliability", read)
    levels = {sequence.name: sequence.level for sequence in sequences}
    measured = {}
    names = [path.name for path in args.results]
    for path in args.results:
        name = path.name if names.count(path.name) == 1 else str(path)
        tracks = list(read_tracks(sequences, path))
        scores = score_tracks(tracks, args.count_resets)
        absent = [name for name in levels if name not in scores]
        if not scores:
            raise InputError(_none_of(path, levels))
        if absent:
            note(f"{path}: no result for {', '.join(absent)}.")
        for sequence, rows in tracks:
            for gap in gaps(sequence, rows):
                note(f"{path}: {sequence.name}: {gap}.")
        print(f"\n{name}\n\n{tracking_table(scores, levels, args.per_sequence)}")
        if args.reliability is not None:
            measured[name] = reliability(*confidences(tracks))
    _write_reliability(measured, args.reliability)
    return 0


def _none_of(path: Path, names: Iterable[str]) -> str:
    """The sentence of results without a track of any sequence."""
    said = f"{path} holds no <sequence>.csv for any of {', '.join(names)}"
    if (path / "poses.csv").is_file():
        return f"{said}; its poses.csv is of one sequence: give that one's folder as --sequences."
    return f"{said}."


def _write_reliability(measured: Mapping[str, Reliability], path: Path | None) -> None:
    """Print a line for each, and write the diagram of all; nothing if none was asked for."""
    from ..visualization.charts import reliability_diagram
    from ..visualization.plots import draw

    if path is None:
        return
    for name, one in measured.items():
        print(f"\n{name}: {one.line()}")
    curves = {name: (one.confidence, one.right) for name, one in measured.items()}
    written = draw(reliability_diagram(path.name, curves), path.parent)
    print(f"\n{', '.join(map(str, written))}")


def bop(args: argparse.Namespace) -> int:
    """Print one table, a row a file."""
    from ..datasets.bop import BopDataset, read_results
    from ..evaluation.bop.add_recall import results_table, score_results, targets_of

    if args.errors == "bop19" and args.reliability is not None:
        raise InputError("--reliability is not for --errors bop19, but for --errors add.")
    if args.errors == "add" and args.targets is not None:
        raise InputError(
            "--targets is not for --errors add, whose targets are those of the first file, but for "
            "--errors bop19."
        )
    check_chart(args, "reliability", folders=folders_of(args))
    use_threads(1)  # many small steps: more threads only wait for each other
    dataset = BopDataset(args.dataset, args.split, mesh_unit=args.mesh_unit)
    files = [(str(path), read_results(path)) for path in args.results]
    if args.errors == "bop19":
        print(_average_recalls(dataset, files, args))
        return 0
    targets = targets_of(files[0][1], dataset)
    scores = [(name, score_results(dataset, rows, targets)) for name, rows in files]
    print(results_table(scores))
    if args.reliability is not None:
        measured = {name: one.reliability for name, one in scores}
        _write_reliability(measured, args.reliability)
    return 0


def _average_recalls(
    dataset: BopDataset, files: Sequence[tuple[str, list[Estimate]]], args: argparse.Namespace
) -> str:
    from ..evaluation.bop.bop19 import bop19_table, has_depth, score_bop19, targets_of
    from ..rendering.backends import make_renderer

    targets = targets_of(dataset, None if args.targets is None else targets_file(args.targets))
    depth = has_depth(dataset, targets)
    if not depth:
        note("this split has no depth images: VSD, and with it AR, cannot be measured.")
    renderer = make_renderer(args.renderer) if depth else None
    scores = []
    with progress_bar(len(files) * len(targets), "targets", "target") as bar:
        for name, rows in files:
            scores.append((name, score_bop19(dataset, rows, targets, renderer, bar.update)))
    return bop19_table(scores)


def ycbv(args: argparse.Namespace) -> int:
    """Print one table, a row a method, and one by object."""
    from ..datasets.ycbv import SYMMETRIC
    from ..evaluation.metrics import auc
    from ..evaluation.ycbv.keyframes import (
        keyframe_errors,
        keyframes_table,
        objects_table,
        read_keyframe_poses,
        read_points,
    )

    use_threads(1)
    keyframes = read_keyframe_poses(args.poses, args.methods)
    symmetric = SYMMETRIC if args.symmetric is None else tuple(args.symmetric)
    unknown = [name for name in symmetric if name not in keyframes.names]
    if args.symmetric and unknown:
        raise InputError(f"--symmetric: {args.poses} has no object {', '.join(unknown)}.")
    points = read_points(args.points)
    area = auc.voc_auc if args.form == "voc" else auc.exact_auc
    found = {
        name: keyframe_errors(keyframes, name, points, symmetric) for name in keyframes.estimates
    }
    print(keyframes_table(found, area))
    if args.per_object:
        print(f"\n{objects_table(found, keyframes.names, area)}\n\n* declared symmetric")
    return 0
