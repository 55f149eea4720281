"""`moveit6d synthesize`: makes sequences with known true poses, in several formats.

Never tracks them.
"""

from __future__ import annotations

import argparse
import itertools
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .apart import check_apart, given_paths
from .common import UNITS, add_untextured_option, add_verb, check_mesh_options, positive, seed
from .messages import progress_bar

if TYPE_CHECKING:
    from ..geometry.mesh import Mesh
    from ..typing import RGBImage

DESCRIPTION = """\
Renders objects in hand-like motion in front of a moving background, with motion blur,
changing light, things passing in front and noise, and writes the true pose of every frame.
The result is what `moveit6d benchmark tracking` and `reproduce` read; `track` reads the frames,
camera.json and meshes of any. `moveit6d synthesize sequence` is the same.

difficulties: easy (slow, never occluded), occ (slow, occluded at times), medium, fast (up to
24 pixels and 10 degrees a frame, blurred), hard (fast, occluded, changing light, clutter)

formats (docs/reference/formats.md):
  folders  one sequence folder; of several (a sequence for each mesh, or --count, of each mesh in
           turn) <difficulty>_<nn>. Files: frames/000000.jpg ..., camera.json, mesh.glb,
           start.json, poses.csv (the truth), info.json, and mesh.symmetry.json of a mesh with
           declared symmetries. A sequence that was made before is replaced
  laval    a surrogate for the Laval data set: for every object OBJECT_occlusion_0 and, for each
           other --occlusion, one sequence with a board in front from below (h) and one from a
           side (v), which hides that share of the object in every frame
  ycbv     a surrogate for YCB-Video as published: --count scenes, in each of which all objects
           stand around one of them in front of a moving camera
A surrogate says so in surrogate.json; visible_fraction.csv has what is seen of each object.
"""

EPILOG = """\
examples:
  moveit6d synthesize --output clip --difficulty medium --seed 3
  moveit6d synthesize --output set --mesh drill.glb --mesh_unit m --difficulty hard --count 4
  moveit6d synthesize sequence --format laval --output laval --mesh boot.glb mug.glb
  moveit6d synthesize sequence --format ycbv --output ycbv --count 3 --frames 60 --difficulty easy
"""

DIFFICULTIES = ("easy", "occ", "medium", "fast", "hard")
FORMATS = ("folders", "laval", "ycbv")
PHOTOS = 200  # pictures of a folder that are used at most
PROCEDURAL_OBJECTS = 4  # of a surrogate without --mesh


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "synthesize", "make sequences with true poses", DESCRIPTION, EPILOG)
    parser.add_argument(
        "what", nargs="?", choices=("sequence",), default="sequence", help=argparse.SUPPRESS
    )
    parser.add_argument("--output", type=Path, required=True, metavar="DIR", help="new folder")
    parser.add_argument("--format", choices=FORMATS, default="folders", help="how it is stored")
    parser.add_argument(
        "--mesh", type=Path, nargs="+", metavar="FILE", help="objects instead of procedural ones"
    )
    parser.add_argument("--mesh_unit", choices=UNITS, help="the meshes' unit (default: m)")
    parser.add_argument(
        "--difficulty", choices=DIFFICULTIES, default="medium", help="how hard it is"
    )
    parser.add_argument("--frames", type=positive, default=120, metavar="N", help="length")
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="same seed, same clip")
    parser.add_argument(
        "--count",
        type=positive,
        metavar="N",
        help="sequences (default: one, or one for each mesh), or scenes for ycbv (default: 1)",
    )
    parser.add_argument(
        "--occlusion",
        type=int,
        nargs="+",
        metavar="PERCENT",
        help="shares of the object that are hidden, for laval (default: 0 15 30 45)",
    )
    parser.add_argument(
        "--photos",
        type=Path,
        metavar="DIR",
        help=f"backgrounds instead of procedural pictures ({PHOTOS} at most, evenly chosen)",
    )
    add_untextured_option(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Make the sequences."""
    from ..synthesis.sequences.sequence import check_replaceable

    check_mesh_options(args)
    if args.occlusion is not None and args.format != "laval":
        raise InputError("--occlusion is for --format laval; other formats go by --difficulty.")
    if args.count is not None and args.format == "laval":
        raise InputError("--count is not for --format laval; give more meshes or levels.")
    folders = _folders(args) if args.format == "folders" else [args.output]
    check_apart({"--output": folders}, given_paths(args, "output"))
    if args.format != "folders":
        make_surrogate(args, _photos(args))
        print(args.output)
        return 0
    for folder in folders:
        check_replaceable(folder)
    photos = _photos(args)
    for number, folder in enumerate(folders):
        make_folder(args, folder, number, photos)
        print(folder)
    return 0


def _folders(args: argparse.Namespace) -> list[Path]:
    """Where each sequence goes; `InputError` where there are not enough for the meshes."""
    meshes = len(args.mesh or ())
    count = args.count or max(1, meshes)
    if count < meshes:
        raise InputError(
            f"--count {count} leaves out {meshes - count} of {meshes} meshes; leave out --count "
            "for a sequence of each."
        )
    if count == 1:
        return [args.output]
    return [args.output / f"{args.difficulty}_{number:02d}" for number in range(count)]


def _photos(args: argparse.Namespace) -> list[RGBImage] | None:
    """The pictures of --photos, up to `PHOTOS` of them, no larger than a background needs."""
    from ..synthesis.augmentation.photos import load_photos
    from ..synthesis.sequences.environment import background_size
    from ..synthesis.sequences.sequence import SEQUENCE_CAMERA

    if args.photos is None:
        return None
    # Frames of all formats are as large.
    return load_photos(args.photos, PHOTOS, background_size(SEQUENCE_CAMERA))


def make_folder(
    args: argparse.Namespace, folder: Path, number: int, photos: list[RGBImage] | None
) -> None:
    """Make one sequence folder, of the given meshes in turn."""
    from ..synthesis.sequences.sequence import write_sequence

    seed = args.seed + number
    mesh = _mesh(args, number % len(args.mesh) if args.mesh else seed)
    with progress_bar(args.frames, folder.name) as bar:
        write_sequence(
            folder,
            mesh=mesh,
            seed=seed,
            frames=args.frames,
            difficulty=args.difficulty,
            photos=photos,
            on_frame=lambda _: bar.update(),
        )


def make_surrogate(args: argparse.Namespace, photos: list[RGBImage] | None) -> None:
    """Make a whole data set in the format of a published one."""
    from ..synthesis.sequences import surrogate_datasets

    count = len(args.mesh) if args.mesh else PROCEDURAL_OBJECTS
    objects: dict[str, Mesh] = {}
    for number in range(count):
        mesh = _mesh(args, number if args.mesh else args.seed + number)
        objects[_free_name(surrogate_datasets.object_name(mesh), number, objects)] = mesh
    levels = args.occlusion if args.occlusion is not None else surrogate_datasets.OCCLUSIONS
    laval, scenes_wanted = args.format == "laval", args.count or 1
    sequences = count * len(surrogate_datasets.laval_kinds(levels)) if laval else scenes_wanted
    with progress_bar(args.frames * sequences, args.format) as bar:
        options = surrogate_datasets.GenerationOptions(
            args.frames, args.difficulty, args.seed, photos, on_frame=lambda *_: bar.update()
        )
        if laval:
            surrogate_datasets.write_laval_surrogate(args.output, objects, options, levels)
        else:
            # Another object in the middle of every scene.
            turns = [
                [*objects][k % count :] + [*objects][: k % count] for k in range(scenes_wanted)
            ]
            scenes = [{name: objects[name] for name in names} for names in turns]
            surrogate_datasets.write_ycbv_surrogate(args.output, scenes, options)


def _free_name(name: str, number: int, taken: Collection[str]) -> str:
    """The name, or else with the first number from `number` on that nobody has."""
    names = (f"{name}_{other}" for other in itertools.count(number))
    return next(other for other in itertools.chain([name], names) if other not in taken)


def _mesh(args: argparse.Namespace, number: int) -> Mesh:
    """The given mesh with that number or, without one, an object made from that seed."""
    import numpy as np

    from ..geometry.mesh import Mesh
    from ..synthesis.objects.shapes import random_object

    if args.mesh:
        allow = args.allow_untextured
        return Mesh.load(args.mesh[number], args.mesh_unit or "m", allow_untextured=allow)
    return random_object(np.random.default_rng(number))
