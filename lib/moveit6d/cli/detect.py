"""`moveit6d detect`: find objects in images, without a start or with what is known.

Never tracks; what it writes is what `moveit6d track --start` reads.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..config import SeedDetectorConfig
from ..errors import InputError
from .camera_options import add_camera_options
from .common import (
    UNITS,
    add_tracking_options,
    add_untextured_option,
    add_verb,
    positive,
)
from .narrowing import add_narrowing_options
from .seed_options import add_seed_options
from .settings import SettingsPart

# The settings that one way or another of detecting reads; of the loop `seeds` alone its limit. The
# errors of width and displacement decide about numbers that are not written.
READ = SettingsPart(
    ("loop", "contour", "detection"),
    but=(
        "loop.augment",
        "loop.augment_size",
        "loop.width_error",
        "loop.displacement_error",
        "contour.histogram_rate",
        "detection.least_distance",
    ),
)
TEMPLATES = SettingsPart(READ.names, but=(*READ.but, "loop.max_iterations"))
SEEDS = SettingsPart(("loop",), but=READ.but)

DESCRIPTION = """\
Compares every place in the image, at every size, with the object seen from all sides, refines the
best candidates and judges them. Whether the object is there is part of the answer. It takes about
two seconds an image with one thread, four to five where the object is not there, after a second or
two of preparation, which is kept for the next call. What is known of where the object is makes it
faster and surer: --box, --mask, --points, --distance and --start.

Several objects: --mesh and --mesh_unit once for each of them (one --mesh_unit does for all); the
same mesh twice are two instances. Of what is known only --distance is for several.

files written to --output:
  poses.csv     the columns of `moveit6d track`, a row an image in the order given (of several
                objects one row each, with a column object before state; with --instances one row
                each, with a column instance, 0 the most probable); empty numbers and the state
                `lost` where the object was not found, `uncertain` where the image cannot be used
                (damaged, of another size) or does not confirm the pose of --points; `confidence`
                is the probability that the pose is right
  pose.json     for one image: the pose found, start of `moveit6d track`; those of more --instances
                pose_2.json, pose_3.json, ...; of several objects pose_NAME.json by column object
  overlay.png   outline and axes drawn on the image; for several images overlay/NAME.png
  detection.json  probabilities, what speaks for the poses, versions, which files were written

with --dataset, --split and --targets, --output is a BOP result file with a pose for every target;
its score is the probability that the pose is right, given that the object is in the image.
With --boxes it looks into those only, the best ones of each target. An image that cannot be used is
named and has no pose.
Several images and data sets: what is found is on disk at once, and --resume goes on with a run that
was interrupted (by what lies beside the results, named *.unfinished).

exit code 3 also says that no object was found in any image; a pose of --points that no image
confirms does not count as found, but is written.
"""

EPILOG = """\
examples:
  moveit6d detect --mesh drill.glb --mesh_unit m --image frames/000000.jpg \\
      --camera camera.json --output found
  moveit6d detect --mesh drill.glb --mesh_unit m --image a.png b.png --camera camera.json \\
      --box 210 140 180 160 --distance 0.4 1.2 --output found
  moveit6d detect --mesh cup.glb --mesh can.glb --mesh_unit m --image a.png \\
      --camera camera.json --output found
  moveit6d detect --dataset lmo --split test --targets test_targets_bop19.json \\
      --boxes detections.json --output results.csv
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "detect", "find objects in images", DESCRIPTION, EPILOG)
    parser.add_argument("--output", type=Path, required=True, metavar="PATH", help="for results")
    images = parser.add_argument_group("images")
    images.add_argument(
        "--mesh",
        type=Path,
        action="append",
        metavar="FILE",
        help="the object; once for each of several",
    )
    images.add_argument(
        "--mesh_unit",
        choices=UNITS,
        action="append",
        help="the mesh's unit; once, or for each mesh; of a data set's models mm if not given",
    )
    images.add_argument("--image", type=Path, nargs="+", metavar="FILE", help="the pictures")
    add_camera_options(images, required=False)
    images.add_argument(
        "--instances",
        type=positive,
        default=1,
        metavar="N",
        help="how many of each object there may be in an image; each further one costs time",
    )
    dataset = parser.add_argument_group("data set")
    dataset.add_argument("--dataset", type=Path, metavar="DIR", help="BOP data set")
    dataset.add_argument("--split", metavar="NAME", help="folder in it, as test")
    dataset.add_argument("--targets", type=Path, metavar="FILE", help="what is to be found")
    dataset.add_argument(
        "--boxes",
        metavar="FILE",
        help="where the objects are: detections in BOP's format (JSON), or `truth`, the true boxes "
        "of what is visible; what has no box is not looked for",
    )
    known = add_narrowing_options(parser)
    known.add_argument("--start", type=Path, metavar="FILE", help="a pose that is roughly right")
    parser.add_argument(
        "--method",
        choices=("templates", "seeds"),
        default="templates",
        help="templates compares with the object seen from all sides; seeds is the paper's way, "
        "by where single iterations lead: one image, no narrowing, minutes",
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on with a run that was interrupted"
    )
    add_seed_options(parser, SeedDetectorConfig())
    add_tracking_options(parser, part=READ)
    add_untextured_option(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Detect and write."""
    if args.dataset is not None:
        from .detect_dataset import run as run_dataset

        return run_dataset(_with_one_unit(args))
    missing = [
        f"--{name}" for name in ("mesh", "mesh_unit", "image") if getattr(args, name) is None
    ]
    if args.camera is None and args.fov is None:
        missing.append("--camera")
    if missing:
        raise InputError(
            f"{', '.join(missing)} missing: --mesh, --mesh_unit, --image and --camera (or --fov) "
            "are needed, or --dataset, --split and --targets."
        )
    mixed = [
        f"--{name}" for name in ("split", "targets", "boxes") if getattr(args, name) is not None
    ]
    if mixed:
        raise InputError(f"{', '.join(mixed)} is not for --image, but for --dataset.")
    from .detect_images import run as run_images

    return run_images(args)


def _with_one_unit(args: argparse.Namespace) -> argparse.Namespace:
    """The arguments with the only unit of --mesh_unit, that of all models of a data set."""
    units = args.mesh_unit or [None]
    if len(units) > 1:
        raise InputError("--dataset takes one --mesh_unit.")
    return argparse.Namespace(**{**vars(args), "mesh_unit": units[0]})
