"""`moveit6d evaluate`: errors of finished results against true poses.

Never tracks or refines.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..errors import InputError
from .common import add_verb, note

DESCRIPTION = """\
Prints Markdown tables.

  moveit6d evaluate tracking   tracks against sequence folders with true poses
  moveit6d evaluate bop        BOP result files against the ground truth of a split
"""

TRACKING = """\
A sequence folder has camera.json, frames/, a mesh (mesh.glb, model.glb, model.ply, metres)
and poses.csv with the true poses, perhaps with holes. Results are a folder with one
<sequence>.csv (or <sequence>/poses.csv) each or, for one sequence, a poses.csv.

columns:
  ADD<10%d, ADD<5%d  share of frames whose ADD (mean distance of 2000 surface points between
                     estimate and truth) is below 10 or 5 % of the object's diameter
  mean, median ADD   millimetres; ADD is cut at one diameter
  frames until lost  first frame from which ADD stays above 10 % for 15 frames
  5cm/5deg           share of frames within 5 cm and 5 degrees
  ms/frame           median of the times in the results

The first frame is the given start and is not scored; a frame without a pose is wrong.
"""

BOP = """\
ADD(-S) is the mean distance of up to 3000 vertices between estimate and truth, for objects
with a symmetry in models_info.json the mean distance to the nearest vertex. The targets are
those that the first file lists; a target that another file lacks is wrong there. Give the
poses before and after a refinement, in this order. Score AUROC says how well the score column
tells poses below 10 % d from others: 1 perfectly, 0.5 not at all.
"""

EXAMPLES_TRACKING = """\
examples:
  moveit6d evaluate tracking --sequences sequences --results out/ours rivals/m3t_region
  moveit6d evaluate tracking --sequences sequences/easy_00 --results out/poses.csv
"""

EXAMPLES_BOP = """\
examples:
  moveit6d evaluate bop --dataset lmo --split test --results initial.csv refined.csv
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "evaluate", "score results against true poses", DESCRIPTION, "")
    kinds = parser.add_subparsers(title="kinds", metavar="KIND", required=True)
    one = add_verb(kinds, "tracking", "score tracks through sequences", TRACKING, EXAMPLES_TRACKING)
    one.add_argument("--sequences", type=Path, required=True, metavar="DIR", help="true poses")
    one.add_argument(
        "--results", type=Path, required=True, nargs="+", metavar="PATH", help="tracks to score"
    )
    one.add_argument("--per_sequence", action="store_true", help="a row for every sequence, too")
    one.set_defaults(run=tracking)
    two = add_verb(kinds, "bop", "score BOP result files by ADD(-S)", BOP, EXAMPLES_BOP)
    two.add_argument("--dataset", type=Path, required=True, metavar="DIR", help="BOP data set")
    two.add_argument("--split", required=True, metavar="NAME", help="folder in it, as test")
    two.add_argument(
        "--results", type=Path, required=True, nargs="+", metavar="FILE", help="files to score"
    )
    two.set_defaults(run=bop)


def tracking(args: argparse.Namespace) -> int:
    """Print a table for each of the results."""
    from ..datasets.sequences import read_sequences
    from ..evaluation.benchmark import score_results
    from ..evaluation.tracking import tracking_table

    sequences = read_sequences(args.sequences)
    levels = {sequence.name: sequence.level for sequence in sequences}
    for path in args.results:
        scores = score_results(sequences, path)
        absent = [name for name in levels if name not in scores]
        if not scores:
            raise InputError(f"{path} holds no <sequence>.csv for any of {', '.join(levels)}.")
        if absent:
            note(f"{path}: no result for {', '.join(absent)}.")
        print(f"\n{path.name}\n\n{tracking_table(scores, levels, args.per_sequence)}")
    return 0


def bop(args: argparse.Namespace) -> int:
    """Print one table, a row a file."""
    from ..datasets.bop import BopDataset, read_results
    from ..evaluation.bop import results_table, score_results, targets_of

    dataset = BopDataset(args.dataset, args.split)
    files = [(str(path), read_results(path)) for path in args.results]
    targets = targets_of(files[0][1], dataset)
    scores = [(name, score_results(dataset, rows, targets)) for name, rows in files]
    print(results_table(scores))
    return 0
