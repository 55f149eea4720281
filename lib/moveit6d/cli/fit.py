"""`moveit6d fit`: trains a network; forwards its arguments to LightningCLI.

Never knows an option of its own.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from typing import Any

from ..extras import require
from .common import add_verb
from .messages import QUIETLY, VERBOSELY, set_level
from .parser import spelt

DESCRIPTION = """\
Trains a network by a configuration file on pairs that are rendered as training goes on. Every
value of the file can be overridden on the command line by its dotted name. Run the same command
again after it was killed and it goes on from its last checkpoint (ckpt_path: last in the file).
Another network, other meshes or other pairs need another --output.

All options are those of LightningCLI: `moveit6d fit --all_options` prints them, and
`moveit6d fit --config FILE --print_config` the configuration that would be used.
"""

EPILOG = """\
examples:
  moveit6d fit --config configs/fit/multi_object_correlation.yaml
  moveit6d fit --config configs/fit/multi_object_correlation.yaml --data.batch_size 16
  moveit6d fit --config configs/fit/object_specific.yaml --config configs/overlay/no_depth.yaml \\
      --data.meshes FOLDER_OF_ONE_MESH --data.pairs configs/pairs/realistic.yaml
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "fit", "train a network", DESCRIPTION, EPILOG)
    parser.add_argument("--config", metavar="FILE", help="configuration, as in configs/fit")
    parser.add_argument("options", nargs=argparse.REMAINDER, help=argparse.SUPPRESS)
    parser.set_defaults(run=lambda args: forward([]))


def forward(arguments: Sequence[str]) -> int:
    """Hand the arguments after `fit` over to the trainer's command line."""
    require("train", "moveit6d fit")
    from lightning_modules.cli import main

    set_level(*(any(word in some for word in arguments) for some in (QUIETLY, VERBOSELY)))
    main(["--help" if word == "--all_options" else word for word in trainer_words(arguments)])
    return 0


def trainer_words(arguments: Sequence[str]) -> list[str]:
    """The arguments as the trainer's command line spells them, without those that are not its."""
    words = [spelt(word) for word in arguments]
    return [word for word in words if word not in (*QUIETLY, *VERBOSELY)]
