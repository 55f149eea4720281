"""`moveit6d demo`: make a clip of an object never seen in training, follow it, print the error.

Never does anything that `synthesize`, `track` and `evaluate` do not do; it runs them in a row.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .common import (
    add_tracking_options,
    add_verb,
    new_folder,
    positive,
    seed,
)
from .messages import progress_bar
from .narrowing import NAMES as NARROWING
from .synthesize import DIFFICULTIES

if TYPE_CHECKING:
    from ..evaluation.track_scores import Score

DESCRIPTION = """\
The clip is made on the spot: a toy robot in hand-like motion, with motion blur, changing light, a
moving background and something that passes in front. Nothing is downloaded. The tracker is given
the mesh, the camera and the pose in the first frame; the true poses are only used for the error.

files written to --output:
  sequence/            the clip: frames/, mesh.glb, camera.json, start.json, poses.csv (the truth)
  track/poses.csv      the poses found
  track/overlay.mp4    outline and axes drawn on the frames
"""

EPILOG = """\
examples:
  moveit6d demo --output demo
  moveit6d demo --output demo --difficulty hard --seed 3
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "demo", "make a clip, follow the object in it, print the error", DESCRIPTION, EPILOG
    )
    parser.add_argument(
        "--output", type=Path, default=Path("demo"), metavar="DIR", help="folder for the results"
    )
    parser.add_argument(
        "--difficulty", choices=DIFFICULTIES, default="medium", help="how hard the clip is"
    )
    parser.add_argument(
        "--seed", type=seed, default=4, metavar="N", help="another seed, another clip"
    )
    parser.add_argument(
        "--frames", type=positive, default=120, metavar="N", help="length of the clip"
    )
    parser.add_argument("--no_overlay", action="store_true", help="leave out overlay.mp4")
    add_tracking_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Make, follow, score."""
    from ..datasets.sequences import read_sequence
    from ..evaluation.track_scores import EvaluationPoints, read_track, score
    from ..synthesis.objects.demo_object import demo_object
    from ..synthesis.sequences.sequence import write_sequence
    from . import track

    folder = new_folder(args.output) / "sequence"
    with progress_bar(args.frames, "clip") as bar:
        write_sequence(
            folder,
            mesh=demo_object(),
            seed=args.seed,
            frames=args.frames,
            difficulty=args.difficulty,
            on_frame=lambda _: bar.update(),
        )
    given = {
        **vars(args),
        "mesh": [folder / "mesh.glb"],
        "mesh_unit": ["m"],
        "allow_untextured": False,
        "resume": False,
        "video": str(folder / "frames"),
        "camera": folder / "camera.json",
        "start": [folder / "start.json"],
        **dict.fromkeys(NARROWING),
        "texture_from_start": False,
        "output": args.output / "track",
        "exact_start": True,
        "report": None,
        "rerun": None,
    }
    code = track.run(argparse.Namespace(**given))
    if code:
        return code
    sequence = read_sequence(folder)[0]
    mesh = sequence.load_mesh()
    found = read_track(args.output / "track" / "poses.csv")
    print(verdict(score(found, sequence.truth, EvaluationPoints.of(mesh)), mesh.diameter))
    if not args.no_overlay:
        print(f"Look at {args.output / 'track' / 'overlay.mp4'}")
    return 0


def verdict(result: Score, diameter: float) -> str:
    """The error against the true poses in two lines."""
    held = "to the end" if result.never_lost else f"until frame {result.until_lost}"
    return (
        f"error against the true poses (ADD): mean {1000 * result.mean_add:.1f} mm, "
        f"median {1000 * result.median_add:.1f} mm\n"
        f"below 10 % of the diameter ({1000 * diameter:.0f} mm): {100 * result.below_10:.1f} % of "
        f"{result.frames} frames; followed {held}"
    )
