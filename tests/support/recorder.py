"""A callback that writes down what a training process was given; used by the tests only."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytorch_lightning as pl
import torch


class PairRecorder(pl.Callback):
    """Saves each batch's deltas and the last weights to `rank<N>.pt`."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.delta = Path(folder), []

    def on_train_batch_end(
        self, trainer: pl.Trainer, pl_module: Any, outputs: Any, batch: Any, *_: Any
    ) -> None:
        self.delta.append(batch.delta)
        weights = torch.cat([value.detach().flatten() for value in pl_module.parameters()])
        found = {"delta": self.delta, "weights": weights}
        torch.save(found, self.folder / f"rank{trainer.global_rank}.pt")
