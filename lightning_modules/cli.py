"""`moveit6d fit`: LightningCLI over the module and the data module; its data for other verbs.

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


class DataCLI(FitCLI):
    """Reads what a fit reads, and stops where the data module is made."""

    def instantiate_classes(self) -> None:
        """Make what the configuration names, but no trainer."""
        made = self.parser.instantiate_classes(self.config)
        self.datamodule = made["fit"]["data"]

    def _run_subcommand(self, subcommand: str) -> None:
        """Fit nothing."""


def read_data(arguments: Sequence[str]) -> PairDataModule:
    """The data module that a fit with these arguments would use; configurations as for `main`."""
    module = _run(DataCLI, [*arguments, "--seed_everything=false"]).datamodule
    assert isinstance(module, PairDataModule)
    return module


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit by the given arguments (those of `moveit6d fit`)."""
    _run(FitCLI, sys.argv[1:] if arguments is None else arguments)


def _run(kind: type[FitCLI], arguments: Sequence[str]) -> FitCLI:
    with warnings.catch_warnings():
        # Arguments are handed in on purpose: `moveit6d` has taken its own verb off them.
        warnings.filterwarnings("ignore", message="LightningCLI's args parameter")
        return kind(
            PoseActionModule,
            PairDataModule,
            args=["fit", *arguments],
            save_config_kwargs={"overwrite": True},
            seed_everything_default=0,
        )
