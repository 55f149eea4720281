"""`moveit6d detect`: find one object in one image, without a start.

Never tracks; what it writes is what `moveit6d track --start` reads.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from ..errors import InputError
from .camera_options import add_camera_options, camera_of
from .common import (
    add_tracking_options,
    add_verb,
    given,
    new_folder,
    set_up,
    versions,
    weights_facts,
)
from .settings import settings_of

DESCRIPTION = """\
Lays seeds over the image, sees where one iteration at each of them wants to go, looks for the
places where the moves converge, and tries a coarse grid of rotations there. The object is
taken to be in the picture. It takes seconds to minutes; a given start is always surer.

files written to --output:
  pose.json     the pose found: start of `moveit6d track`
  overlay.png   outline and axes drawn on the image
  detection.json  confidence, iterations, the places looked into, versions
"""

EPILOG = """\
examples:
  moveit6d detect --mesh drill.glb --mesh_unit m --image frames/000000.jpg \\
      --camera camera.json --output found
  moveit6d detect --mesh drill.glb --mesh_unit m --image first.png --camera camera.json \\
      --output found --criterion iterations --rotations 120
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "detect", "find an object in an image", DESCRIPTION, EPILOG)
    parser.add_argument("--mesh", type=Path, required=True, metavar="FILE", help="the object")
    parser.add_argument("--mesh_unit", choices=("m", "mm"), required=True, help="the mesh's unit")
    parser.add_argument("--image", type=Path, required=True, metavar="FILE", help="the picture")
    add_camera_options(parser)
    parser.add_argument("--output", type=Path, required=True, metavar="DIR", help="for results")
    parser.add_argument(
        "--criterion",
        choices=("confidence", "iterations"),
        default="confidence",
        help="chooses the best candidate: the network's confidence, or the fewest iterations",
    )
    parser.add_argument(
        "--sizes",
        type=float,
        nargs="+",
        default=[0.13, 0.2, 0.3],
        metavar="SHARE",
        help="widths of the object to try, in shares of the image's shorter side",
    )
    parser.add_argument("--rotations", type=int, default=60, metavar="N", help="of the grid")
    parser.add_argument("--sinks", type=int, default=3, metavar="N", help="places looked into")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of the seeded poses")
    add_tracking_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Detect and write."""
    from PIL import Image

    from ..datasets.video import ImageList
    from ..estimation import PoseDetector, SeedDetectorConfig
    from ..geometry.mesh import Mesh
    from ..io import replacing, write_json
    from ..visualization.overlay import draw_pose

    mesh, images = Mesh.load(args.mesh, args.mesh_unit), ImageList((args.image,))
    camera, frame = camera_of(args, images), next(iter(images))
    if frame.image is None:
        raise InputError(f"{args.image}: {frame.error}")
    config = SeedDetectorConfig(
        sizes=tuple(args.sizes),
        sinks=args.sinks,
        rotations=args.rotations,
        seed=args.seed,
        criterion=args.criterion,
        loop=settings_of(args).loop,
    )
    policy, renderer = set_up(args)
    detector = PoseDetector(
        mesh, camera, policy=policy, renderer=renderer, config=config, threads=args.threads
    )
    found = detector.detect(frame.image)
    if found.result is None or found.pose is None:
        raise InputError(f"{args.image}: the object was not found; try other --sizes.")
    output = new_folder(args.output)
    found.pose.save(output / "pose.json")
    with replacing(output / "overlay.png") as temporary:
        Image.fromarray(draw_pose(frame.image, mesh, found.pose, camera, renderer)).save(temporary)
    facts = {
        "confidence": found.result.confidence,
        "iterations": found.result.iterations,
        "candidates": len(found.candidates),
        "sinks": [
            {"pixel": s.centre.tolist(), "strength": s.strength, "size": s.size}
            for place in found.places
            for s in place
        ],
        **weights_facts(args.weights),
        "versions": versions(),
        "arguments": given(args),
    }
    write_json(output / "detection.json", facts)
    print(f"confidence {found.result.confidence:.2f}: {output / 'pose.json'}")
    return 0
