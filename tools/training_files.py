"""The meshes and photographs of a fit, as the tools that come after it take them.

    python -m tools.training_files [OPTIONS OF moveit6d fit]

Prints the options with which those tools take the meshes of that fit. `InputError` where they
cannot: before the hours of the fit, not after them.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from lightning_modules.cli import read_data
from lightning_modules.pair_data_module import PairDataModule
from moveit6d.cli.common import UNITS
from moveit6d.cli.fit import trainer_words
from moveit6d.errors import InputError
from moveit6d.synthesis.augmentation.photos import read_photos
from moveit6d.synthesis.sequences.environment import background_size
from moveit6d.synthesis.sequences.sequence import SEQUENCE_CAMERA
from moveit6d.typing import RGBImage

LEAST_HELD_OUT = 2  # an object in the picture, and one that is not there


def main(arguments: Sequence[str] | None = None) -> int:
    """Print unit and number of held-out meshes."""
    data = read_data(trainer_words(sys.argv[1:] if arguments is None else arguments))
    check_held_out(data)
    print(f"--mesh_unit {data.mesh_unit} --holdout {data.holdout}")
    return 0


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options that say which files a fit was given."""
    parser.add_argument("--meshes", type=Path, required=True, help="training meshes")
    parser.add_argument("--photos", type=Path, required=True, help="backgrounds")
    add_mesh_unit(parser)
    parser.add_argument(
        "--holdout", type=int, default=8, help="data.holdout of the fit: meshes it did not train on"
    )


def add_mesh_unit(parser: argparse.ArgumentParser) -> None:
    """The option for the unit of mesh files."""
    parser.add_argument("--mesh_unit", choices=UNITS, default="m", help="unit of the meshes")


def data_of(args: argparse.Namespace) -> PairDataModule:
    """The meshes by the options of `add_options`."""
    return PairDataModule(meshes=args.meshes, mesh_unit=args.mesh_unit, holdout=args.holdout)


def check_held_out(data: PairDataModule) -> None:
    """`InputError` where too few meshes are held out, or all of them."""
    data.mesh_paths()
    if data.holdout < LEAST_HELD_OUT:
        raise InputError(
            f"data.holdout is {data.holdout}, but probabilities are fitted on held-out meshes: set "
            f"it to {LEAST_HELD_OUT} or more."
        )


def read_photographs(paths: Sequence[Path]) -> list[RGBImage]:
    """The photographs that can be used, as large as the background of a frame needs them."""
    return read_photos(paths, background_size(SEQUENCE_CAMERA), f"The list of {len(paths)} photos")


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"training_files: {error}")
