"""Callbacks of a fit: its last checkpoint, weights files beside it, a line of figures now and then.

Never changes what is trained.
"""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import pytorch_lightning as pl
import torch
from pytorch_lightning.callbacks import ModelCheckpoint
from torch import Tensor

from moveit6d.errors import InputError
from moveit6d.networks.weights_file import WEIGHTS_NAME

from .pose_action_module import PoseActionModule


class LastCheckpoint(ModelCheckpoint):
    """`last.ckpt`: every so many steps, at the end of a fit, and where it is interrupted."""

    def on_train_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Keep the end, wherever the last of those steps was."""
        if not self._should_skip_saving_checkpoint(trainer):
            self._save_last_checkpoint(trainer, self._monitor_candidates(trainer))

    def on_exception(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, exception: BaseException
    ) -> None:
        """Keep what was reached; Lightning's own way leaves a second file of the same step."""
        if self._should_save_on_exception(trainer):
            self._save_last_checkpoint(trainer, self._monitor_candidates(trainer))


class WeightsExport(pl.Callback):
    """Writes `weights.safetensors`, ready for `moveit6d track --weights`, every so many steps.

    Also where `LastCheckpoint` is written: at the end of a fit, and where it is interrupted. Of a
    network that was not trained nothing is written.
    """

    def __init__(self, folder: Path, every_n_steps: int = 500) -> None:
        _check_every("export", every_n_steps)
        self.path, self.every = Path(folder) / WEIGHTS_NAME, every_n_steps
        self.exported = 0  # the last step that was

    def on_train_batch_end(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, *_: Any
    ) -> None:
        """Export if it is time."""
        if trainer.global_step % self.every == 0:
            self._export(trainer, pl_module)

    def on_train_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Export the end of the training."""
        self._export(trainer, pl_module)

    def on_exception(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, exception: BaseException
    ) -> None:
        """Export what was reached, where the checkpoint keeps it."""
        fit: Any = trainer
        if not fit.fast_dev_run and not fit.sanity_checking:
            self._export(trainer, pl_module)

    def _export(self, trainer: pl.Trainer, module: pl.LightningModule) -> None:
        """Once a step, however many batches it takes; only the first process writes."""
        assert isinstance(module, PoseActionModule)
        if trainer.is_global_zero and trainer.global_step != self.exported:
            module.export(self.path, {"made_by": "moveit6d fit"})
            self.exported = trainer.global_step


class FigureLine(pl.Callback):
    """Prints the means of the training terms every so many steps: a log that a person can read."""

    def __init__(self, every_n_steps: int = 100) -> None:
        _check_every("figures", every_n_steps)
        self.every = every_n_steps
        self.step = 0  # the last one that was added, or that the fit goes on from
        self.sums: dict[str, tuple[Tensor, int]] = {}
        self.start = time.monotonic()

    def on_train_start(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Begin after what was done before."""
        self.step = trainer.global_step

    def on_train_batch_end(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, *_: Any
    ) -> None:
        """Add a step's terms when it is done; print and forget them if it is time."""
        assert isinstance(pl_module, PoseActionModule)
        if trainer.global_step == self.step:  # the next one takes more batches
            return
        self.step = trainer.global_step
        for name, value in pl_module.values.items():  # stay where they are: no step waits for them
            total, number = self.sums.get(name, (torch.zeros_like(value), 0))
            self.sums[name] = total + value, number + 1
        if trainer.global_step % self.every == 0 and trainer.is_global_zero:
            means = " ".join(f"{n} {float(v) / k:.3f}" for n, (v, k) in self.sums.items())
            minutes = (time.monotonic() - self.start) / 60
            print(f"step {trainer.global_step} {minutes:.2f} min: {means}", flush=True)
            self.sums = {}

    def on_validation_end(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        """Print the validation terms."""
        values = {k: float(v) for k, v in trainer.callback_metrics.items() if k.startswith("val/")}
        line = " ".join(f"{name} {value:.3f}" for name, value in sorted(values.items()))
        print(f"validation at step {trainer.global_step}: {line}", flush=True)


def _check_every(name: str, steps: int) -> None:
    if steps < 1:
        raise InputError(f"{name}.every_n_steps is {steps}, must be 1 or more.")
