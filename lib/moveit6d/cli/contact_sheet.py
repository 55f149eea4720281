"""`moveit6d contact-sheet`: shows the pairs that a configuration trains on.

Never trains.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..extras import require
from .apart import check_apart, given_paths
from .common import add_verb, positive, seed, use_threads

if TYPE_CHECKING:
    from lightning_modules.pair_data_module import PairDataModule

    from ..synthesis.training.pairs import TrainingBatch
    from ..synthesis.training.source import PairSource

DESCRIPTION = """\
Draws training pairs as `moveit6d fit` would with the same configuration, and writes one PNG. Each
pair is four patches: what the camera sees; the rendering of the start; what the camera sees with
the outlines of the true pose (green) and of the start (red); and the object's mask, white where it
can be seen, dark red where it is occluded. With data.written, pairs of one of its shards.
"""

EPILOG = """\
examples:
  moveit6d contact-sheet --output sheet.png
  moveit6d contact-sheet --config configs/fit/multi_object.yaml --output sheet.png \\
      --set data.pairs=configs/pairs/realistic.yaml --set data.meshes=MESH_FOLDER
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "contact-sheet", "show the pairs that a fit trains on", DESCRIPTION, EPILOG
    )
    add_data_options(parser)
    parser.add_argument("--output", type=Path, required=True, metavar="FILE", help="PNG to write")
    parser.add_argument("--count", type=positive, default=24, metavar="N", help="pairs")
    parser.add_argument("--across", type=positive, default=2, metavar="N", help="pairs a row")
    parser.add_argument("--seed", type=seed, default=0, metavar="N", help="same seed, same pairs")
    parser.add_argument(
        "--cluster",
        metavar="NAME",
        help="starts of one_small, one_large, one_large_rest_small, all_small, all_large or near "
        "alone instead of the configuration's mixture",
    )
    parser.set_defaults(run=run)


def add_data_options(parser: argparse.ArgumentParser) -> None:
    """The options of whatever draws pairs by a configuration of `moveit6d fit`."""
    group = parser.add_argument_group("pairs")
    group.add_argument(
        "--config",
        type=Path,
        action="append",
        default=[],
        metavar="FILE",
        help="configuration of a fit; several: later ones override (default: the program's own)",
    )
    group.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="override one value, as --NAME VALUE does for `moveit6d fit`",
    )


def data_of(args: argparse.Namespace) -> PairDataModule:
    """The data module by the options of `add_data_options`."""
    require("train", "The configuration of a fit")
    from lightning_modules.cli import read_data

    words = [f"--config={path}" for path in args.config]
    return read_data(words + [f"--{word}" for word in args.set])


def run(args: argparse.Namespace) -> int:
    """Draw the pairs and write the picture."""
    from PIL import Image

    from ..io import replacing
    from ..synthesis.training.contact_sheet import contact_sheet

    use_threads(1)
    data = data_of(args)
    named = (Path(word.partition("=")[2]) for word in args.set)
    read = [*given_paths(args, "output"), *filter(Path.is_file, named)]
    if data.written is not None:
        check_apart({"--output": (args.output,)}, read, [data.written])
        batch = _written(data, data.written, args)
    else:
        source = data.source()
        read += [*source.meshes, *source.occluders]
        folders = [] if source.photos is None else [source.photos]
        check_apart({"--output": (args.output,)}, read, folders)
        batch = _drawn(source, args)
    sheet = contact_sheet(batch, args.across)
    with replacing(args.output) as temporary:
        Image.fromarray(sheet).save(temporary, format="png")
    print(args.output)
    return 0


def _drawn(source: PairSource, args: argparse.Namespace) -> TrainingBatch:
    import numpy as np

    random = np.random.default_rng(args.seed)
    photos, meshes = source.load_photos(random), source.load_meshes()
    meshes += source.make_shapes(random, photos, meshes)
    generator = source.generator(random, photos, meshes, source.load_occluders())
    return generator.batch(args.count, args.cluster)


def _written(data: PairDataModule, folder: Path, args: argparse.Namespace) -> TrainingBatch:
    from lightning_modules.pair_streams import WrittenStream

    from ..synthesis.training.shards import open_shards

    if args.cluster is not None:
        raise InputError("--cluster is for pairs that are drawn, and data.written is set.")
    plan, _ = open_shards(folder)
    most = plan.batches * plan.batch_size
    if args.count > most:
        raise InputError(
            f"--count is {args.count}, and a shard of {folder} holds {most} pairs: give fewer."
        )
    return next(iter(WrittenStream(folder, args.count, args.seed, 0, 0, 1, data.dihedral)))
