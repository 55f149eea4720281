"""`moveit6d synthesize`: makes sequences with known true poses.

Never tracks them.
"""

from __future__ import annotations

import argparse
import itertools
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .common import add_verb, positive, progress_bar

if TYPE_CHECKING:
    from ..datasets.video import Image

DESCRIPTION = """\
Renders an object in hand-like motion in front of a moving background, with motion blur,
changing light, things passing in front, noise and JPEG, and writes the true pose of every
frame. The result is what `moveit6d benchmark tracking` and `moveit6d track` read.

levels: easy (slow, never covered), occ (slow, covered at times), medium, fast (up to 24 pixels
and 10 degrees a frame, blurred), hard (fast, covered, changing light, cluttered background)

files written to --output (with --count 2 or more: to --output/<level>_<nn>):
  frames/000000.jpg ..., camera.json, mesh.glb, start.json, poses.csv (the truth), info.json
"""

EPILOG = """\
examples:
  moveit6d synthesize --output clip --level medium --seed 3
  moveit6d synthesize --output set --mesh drill.glb --mesh_unit m --level hard --count 4
"""

LEVELS = ("easy", "occ", "medium", "fast", "hard")
PHOTOS = 200  # pictures of a folder that are used at most


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "synthesize", "make sequences with true poses", DESCRIPTION, EPILOG)
    parser.add_argument("--output", type=Path, required=True, metavar="DIR", help="new folder")
    parser.add_argument("--mesh", type=Path, metavar="FILE", help="object instead of a made one")
    parser.add_argument("--mesh_unit", choices=("m", "mm"), default="m", help="the mesh's unit")
    parser.add_argument("--level", choices=LEVELS, default="medium", help="how hard it is")
    parser.add_argument("--frames", type=positive, default=120, metavar="N", help="length")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="same seed, same clip")
    parser.add_argument("--count", type=positive, default=1, metavar="N", help="sequences")
    parser.add_argument(
        "--photos", type=Path, metavar="DIR", help="pictures for backgrounds instead of made ones"
    )
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Make the sequences."""
    from ..datasets.video import open_frames

    photos = None
    if args.photos is not None:
        found = itertools.islice(open_frames(args.photos), PHOTOS)
        photos = [frame.image for frame in found if frame.image is not None]
    for number in range(args.count):
        alone = args.count == 1
        folder = args.output if alone else args.output / f"{args.level}_{number:02d}"
        make(args, folder, args.seed + number, photos)
        print(folder)
    return 0


def make(args: argparse.Namespace, folder: Path, seed: int, photos: list[Image] | None) -> None:
    """Make one sequence."""
    import numpy as np

    from ..geometry.mesh import Mesh
    from ..synthesis.sequence import write_sequence
    from ..synthesis.shapes import random_object

    if args.mesh is not None:
        mesh = Mesh.load(args.mesh, args.mesh_unit)
    else:
        mesh = random_object(np.random.default_rng(seed))
    with progress_bar(args.frames, folder.name) as bar:
        write_sequence(
            folder,
            mesh=mesh,
            seed=seed,
            frames=args.frames,
            level=args.level,
            photos=photos,
            on_frame=lambda _: bar.update(),
        )
