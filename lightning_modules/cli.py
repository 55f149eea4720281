"""`moveit6d fit`: LightningCLI over the module and the data module.

Never more than arguments.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence

import torch
from pytorch_lightning.cli import LightningArgumentParser, LightningCLI

from .pair_data_module import PairDataModule
from .pose_action_module import PoseActionModule


class FitCLI(LightningCLI):
    """LightningCLI with the number of threads as an option."""

    def add_arguments_to_parser(self, parser: LightningArgumentParser) -> None:
        """Add what concerns the process and not a class."""
        parser.add_argument("--threads", type=int, default=0, help="CPU threads; 0: torch's choice")

    def before_instantiate_classes(self) -> None:
        """Limit the threads before anything is computed."""
        threads = self.config["fit"]["threads"]
        if threads:
            torch.set_num_threads(threads)


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit by the given arguments (those of `moveit6d fit`)."""
    given = sys.argv[1:] if arguments is None else list(arguments)
    with warnings.catch_warnings():
        # Arguments are handed in on purpose: `moveit6d` has taken its own verb off them.
        warnings.filterwarnings("ignore", message="LightningCLI's args parameter")
        FitCLI(
            PoseActionModule,
            PairDataModule,
            args=["fit", *given],
            save_config_kwargs={"overwrite": True},
            seed_everything_default=0,
        )
