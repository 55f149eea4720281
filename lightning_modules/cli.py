"""`moveit6d fit`: LightningCLI over the module and the data module; its data for other verbs.

Never more than arguments.
"""

from __future__ import annotations

import ctypes
import site
import sys
import sysconfig
import warnings
from collections.abc import Sequence
from pathlib import Path

import torch
from pytorch_lightning.callbacks import ModelCheckpoint
from pytorch_lightning.cli import LightningArgumentParser, LightningCLI

from .callbacks import FigureLine, WeightsExport
from .pair_data_module import PairDataModule
from .pose_action_module import PoseActionModule

EVERY = 250  # steps between checkpoints and between weights files, if nothing else is asked for


class FitCLI(LightningCLI):
    """LightningCLI with the number of threads, and one folder for all that a fit writes."""

    def add_arguments_to_parser(self, parser: LightningArgumentParser) -> None:
        """Add what concerns the process, and the callbacks that every fit has."""
        parser.add_argument("--threads", type=int, default=0, help="CPU threads; 0: torch's choice")
        parser.add_argument(
            "--output",
            type=str,
            default="runs/fit",
            help="folder of checkpoints, weights, logs",
        )
        callbacks = {"checkpoint": ModelCheckpoint, "export": WeightsExport, "figures": FigureLine}
        for name, kind in callbacks.items():
            parser.add_lightning_class_args(kind, name)
        parser.set_defaults(
            {
                "checkpoint.every_n_train_steps": EVERY,
                "checkpoint.save_last": True,
                "checkpoint.save_top_k": 0,
                "export.every_n_steps": EVERY,
            }
        )
        for target in ("checkpoint.dirpath", "export.folder", "trainer.default_root_dir"):
            parser.link_arguments("output", target)

    def before_instantiate_classes(self) -> None:
        """Limit the threads, and settle the memory, before anything is computed."""
        keep_memory()
        threads = self.config["fit"]["threads"]
        if threads:
            torch.set_num_threads(threads)


def keep_memory() -> None:
    """Have the C library keep what was freed instead of giving it back to the kernel.

    A training step on a CPU asks for the same hundreds of megabytes again and again; getting fresh
    pages each time took a quarter of the step on a virtual machine. Does nothing where there is no
    `mallopt` (other C libraries than glibc).
    """
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None) if sys.platform == "linux" else None
    if mallopt is not None:
        trim_threshold, top_pad, mmap_max = -1, -2, -4  # <malloc.h>
        mallopt(trim_threshold, 2**31 - 1)
        mallopt(top_pad, 2**28)
        mallopt(mmap_max, 0)


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


def installed(word: str) -> str:
    """An argument that names a file of `configs/` that is not here, as the one of the package.

    Other arguments as they are.
    """
    option, equals, value = word.rpartition("=")
    if not value.startswith("configs/") or Path(value).exists():
        return word
    shared = [Path(root) / "share/moveit6d" for root in (_prefix(), site.getuserbase())]
    for root in (*shared, Path(__file__).parents[1]):  # the last one: installed to be edited
        if (root / value).is_file():
            return f"{option}{equals}{root / value}"
    return word


def _prefix() -> str:
    return sysconfig.get_path("data")


def _run(kind: type[FitCLI], arguments: Sequence[str]) -> FitCLI:
    with warnings.catch_warnings():
        # Arguments are handed in on purpose: `moveit6d` has taken its own verb off them.
        warnings.filterwarnings("ignore", message="LightningCLI's args parameter")
        return kind(
            PoseActionModule,
            PairDataModule,
            args=["fit", *map(installed, arguments)],
            save_config_kwargs={"overwrite": True},
            seed_everything_default=0,
        )
