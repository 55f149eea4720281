"""`moveit6d fit`: LightningCLI over the module and the data module; its data for other verbs.

Never more than arguments.
"""

from __future__ import annotations

import ctypes
import re
import site
import sys
import sysconfig
import warnings
from argparse import ArgumentError
from collections.abc import Iterator, Sequence
from pathlib import Path
from pickle import UnpicklingError
from typing import Any

import torch
from jsonargparse import Namespace
from lightning_fabric.utilities.exceptions import MisconfigurationException
from pytorch_lightning.cli import LightningArgumentParser, LightningCLI

from moveit6d.checks import DAMAGE, reading
from moveit6d.errors import InputError
from moveit6d.io import IS_READ, check_places, check_writable, read_text
from moveit6d.networks.weights_file import WEIGHTS_NAME

from .callbacks import FigureLine, LastCheckpoint, WeightsExport
from .fit_record import RECORD, claim
from .pair_data_module import PairDataModule
from .pose_action_module import PoseActionModule

MOST_ALIASES, LARGEST_CONFIGURATION = 50, 1 << 20  # of YAML; characters
SAVED_CONFIG = "config.yaml"  # as Lightning calls what it saves of a fit
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
        callbacks = {"checkpoint": LastCheckpoint, "export": WeightsExport, "figures": FigureLine}
        for name, kind in callbacks.items():
            parser.add_lightning_class_args(kind, name)
        parser.set_defaults(
            {
                "checkpoint.every_n_train_steps": EVERY,
                "checkpoint.save_last": True,
                "checkpoint.save_top_k": 0,
                "checkpoint.save_on_exception": True,  # Ctrl-C and SIGTERM lose nothing
                "checkpoint.enable_version_counter": False,  # there is one `last.ckpt`
                "export.every_n_steps": EVERY,
            }
        )
        for target in ("checkpoint.dirpath", "export.folder", "trainer.default_root_dir"):
            parser.link_arguments("output", target)

    def parse_arguments(self, parser: LightningArgumentParser, args: Any) -> None:
        """Read the configuration; what is wrong in it is an `InputError`."""
        with reading("the configuration of the fit"):
            super().parse_arguments(parser, args)

    def instantiate_classes(self) -> None:
        """Make what the configuration names; what cannot be made is an `InputError`."""
        with reading("the configuration of the fit"):
            super().instantiate_classes()

    def before_fit(self) -> None:
        """Say before the work where nothing can be written, or what is there is another fit's."""
        folder = Path(self.config["fit"]["output"])
        check_writable(folder / WEIGHTS_NAME)
        assert isinstance(self.model, PoseActionModule)
        assert isinstance(self.datamodule, PairDataModule)
        saved = Path(self.trainer.log_dir or folder) / SAVED_CONFIG
        written = {"--output": (folder / WEIGHTS_NAME, folder / RECORD, saved)}
        check_places(written, dict.fromkeys(self._read(), IS_READ))
        claim(folder, {**self.model.facts(), **self.datamodule.facts()})
        _check_checkpoint(self._checkpoint())

    def _checkpoint(self) -> Path | None:
        """The file that the fit goes on from, if there is one."""
        given = self.config["fit"].get("ckpt_path")
        if given != "last":
            return None if given is None else Path(given)
        found = Path(self.config["fit"]["output"]).glob("last*.ckpt")
        return max(found, key=lambda path: path.stat().st_mtime, default=None)

    def _read(self) -> Iterator[Path]:
        """The single files that the fit reads: configurations and weights."""
        yield from (Path(str(path)) for path in self.config["fit"].get("config") or ())
        model, teacher = self.model, self.model.teacher
        weights = (model.init_from, teacher and teacher.path, self.datamodule.rollouts.weights)
        yield from (path for path in weights if path is not None)

    def before_instantiate_classes(self) -> None:
        """Limit the threads, and settle the memory, before anything is computed."""
        keep_memory()
        threads = self.config["fit"]["threads"]
        if threads < 0:
            raise InputError(f"threads is {threads}, must be 0 or more (0: torch's choice).")
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
        """Make the data module alone, which needs no network, no weights and no trainer."""
        parser = LightningArgumentParser()
        parser.add_lightning_class_args(PairDataModule, "data")
        given = Namespace(data=self.config["fit"]["data"])  # type: ignore[no-untyped-call]
        with reading("the configuration of the fit"):
            self.datamodule = parser.instantiate(given)["data"]

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
    arguments = [installed(word) for word in arguments]
    for path in _configurations(arguments):
        _check_configuration(path)
    # Errors are raised, not printed behind pages of usage.
    errors: Any = {"exit_on_error": False}
    try:
        with warnings.catch_warnings():
            # Arguments are handed in on purpose: `moveit6d` has taken its own verb off them.
            warnings.filterwarnings("ignore", message="LightningCLI's args parameter")
            return kind(
                PoseActionModule,
                PairDataModule,
                args=["fit", *arguments],
                save_config_kwargs={"overwrite": True},
                seed_everything_default=0,
                auto_configure_optimizers=False,  # rates and decay are the module's options
                parser_kwargs={**errors, "fit": errors},
            )
    except ArgumentError as error:
        remedy = "`moveit6d fit --all_options` lists what there is"
        raise InputError(f"fit: {_refusal(str(error.message))}; {remedy}.") from error
    except MisconfigurationException as error:  # as of a GPU that is not there
        reason = " ".join(str(error).split())[:300].rstrip(".!")
        raise InputError(
            f"fit: the trainer refuses what is set for it ({reason}): change that under trainer "
            "(without a GPU: trainer.accelerator cpu)."
        ) from error
    except OSError as error:  # the disk is full, or gone
        place = f" {error.filename}" if error.filename else ""
        raise InputError(
            f"fit: a file cannot be written or read{place} ({error.strerror or error}); the last "
            "checkpoint is kept, and the same command goes on from it."
        ) from error
    except InputError as error:
        raise InputError(_sentence(str(error))) from error
    except SystemExit as end:
        # Lightning answers Ctrl-C with the exit code of a defect.
        if isinstance(end.__context__, KeyboardInterrupt):
            raise end.__context__ from None
        raise


def _refusal(text: str) -> str:
    """Option and reason, out of a page that says of each type, and each part, why a value is none.

    Every part of a value stands further to the right than what it is of.
    """
    key = ".".join(re.findall(r'^[ -]*Parser key "([^"]+)":$', text, re.MULTILINE))
    if not key:
        return " ".join(text.split())[:300].rstrip(".")
    lines = [line for line in text.splitlines() if line.strip()]
    deepest = max(len(line) - len(line.lstrip()) for line in lines)
    reasons = [line.strip(" -") for line in lines if not line[:deepest].strip()]
    return f"{key}: {'; '.join(dict.fromkeys(reasons))[:300].rstrip('.')}"


def _sentence(text: str) -> str:
    """What an error says; of one from a worker process without the traceback that torch adds."""
    if not text.startswith("Caught InputError in DataLoader worker"):
        return text
    return " ".join(text.rpartition("InputError: ")[2].split())


def _check_checkpoint(path: Path | None) -> None:
    """Refuse a file to go on from that a full disk, or a copy that was killed, has cut off."""
    if path is None or not path.is_file():
        return
    try:
        whole = "state_dict" in torch.load(path, map_location="cpu", weights_only=False)
    except (*DAMAGE, RuntimeError, UnpicklingError, ImportError):
        whole = False
    if not whole:
        raise InputError(
            f"{path} is damaged or no checkpoint of a fit: remove it to begin anew "
            "(--model.init_from begins with the weights beside it), or give another --ckpt_path."
        )


def _configurations(arguments: Sequence[str]) -> Iterator[Path]:
    """The files of `--config FILE` and `--config=FILE`."""
    for word, following in zip(arguments, [*arguments[1:], ""], strict=True):
        if word in ("--config", "-c"):
            yield Path(following)
        elif word.startswith("--config="):
            yield Path(word.partition("=")[2])


def _check_configuration(path: Path) -> None:
    """Refuse what is no YAML text, or would unfold without end."""
    import yaml

    text = read_text(path)
    try:
        aliases = sum(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text))
    except (yaml.YAMLError, RecursionError, ValueError) as error:
        reason = " ".join(str(error).split())[:160] or "it is nested too deeply"
        raise InputError(f"{path} is not a YAML file: {reason}.") from error
    if aliases > MOST_ALIASES or len(text) > LARGEST_CONFIGURATION:
        raise InputError(
            f"{path} is no configuration: it is too long, or repeats itself too often."
        )
