"""The Lightning module that trains a network to move objects, object-specific or multi-object.

Never draws data. One class for both networks; the losses are in `losses`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import pytorch_lightning as pl
import torch
from torch import Tensor
from torch.nn.utils import convert_conv2d_weight_memory_format

from moveit6d.actions import expert_action
from moveit6d.errors import InputError
from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.correlation import CorrelationNet
from moveit6d.networks.weights_file import begin_from, load_network, save_network
from moveit6d.synthesis.training.pairs import TrainingBatch

from .losses import LossWeights, action_loss, correlation_losses, is_right, point_error


class PoseActionModule(pl.LightningModule):
    """Trains a `CorrelationNet` or an `ActionNet` on `TrainingBatch`es.

    Args:
        network: the network to train; None: the one in `init_from`.
        learning_rate: at its peak, after `warmup_steps`.
        schedule: `cosine` to 2 % of the peak at `total_steps`, or `paper`: 5 % less every 1,000.
        total_steps: length of the cosine.
        matching_steps: first steps in which only the matching reaches the encoder.
        weights: weights of the loss terms.
        init_from: weights file (.safetensors) to start from instead of random numbers; of a network
            of the same sizes as `network` or a shallower one (`begin_from`), if there is one.
    """

    def __init__(
        self,
        network: CorrelationNet | ActionNet | None = None,
        learning_rate: float = 1.5e-3,
        schedule: str = "cosine",
        total_steps: int = 20_000,
        warmup_steps: int = 40,
        weight_decay: float = 1e-4,
        matching_steps: int = 500,
        weights: LossWeights | None = None,
        init_from: Path | None = None,
    ) -> None:
        super().__init__()
        if schedule not in ("cosine", "paper"):
            raise ValueError(f"schedule must be 'cosine' or 'paper', found {schedule!r}.")
        self.network = _network(network, init_from)
        convert_conv2d_weight_memory_format(self.network, torch.channels_last)  # faster on CPUs
        self.learning_rate, self.schedule = learning_rate, schedule
        self.total_steps, self.warmup_steps = total_steps, warmup_steps
        self.weight_decay, self.matching_steps = weight_decay, matching_steps
        self.weights = weights or LossWeights()

    def on_fit_start(self) -> None:
        """`InputError` if the pairs show other crops than the network says that it is made for."""
        pairs = getattr(getattr(self.trainer, "datamodule", None), "pairs", None)
        crop = self.network.config.crop
        if pairs is not None and pairs.crop != crop:
            raise InputError(
                f"The pairs show {pairs.crop} crops, the network is made for {crop} ones: set "
                "data.pairs.crop and model.network.init_args.config.crop to the same."
            )

    def transfer_batch_to_device(
        self, batch: TrainingBatch, device: torch.device, dataloader_idx: int
    ) -> TrainingBatch:
        """Lightning cannot move frozen dataclasses by itself."""
        return batch.to(device)

    def training_step(self, batch: TrainingBatch, _: int) -> Tensor:
        """One loss; its terms are logged as `train/NAME`."""
        loss, values = self._shared_step(batch)
        size = len(batch.delta)
        self.log_dict({f"train/{name}": value for name, value in values.items()}, batch_size=size)
        self.log("loss", loss, prog_bar=True, batch_size=size)
        return loss

    def validation_step(self, batch: TrainingBatch, _: int) -> None:
        """The same terms on held-out objects, logged as `val/NAME`."""
        loss, values = self._shared_step(batch)
        values["loss"] = loss
        size = len(batch.delta)
        # Of all training processes together, each of which has a part of the batches.
        named = {f"val/{name}": value for name, value in values.items()}
        self.log_dict(named, batch_size=size, sync_dist=True)

    def _shared_step(self, batch: TrainingBatch) -> tuple[Tensor, dict[str, Tensor]]:
        if isinstance(self.network, ActionNet):
            prediction, _ = self.network(batch.observation)
            loss = action_loss(prediction, batch)
            right = prediction.logits.argmax(-1) == expert_action(batch.delta)
            return loss, {"actions": loss.detach(), "accuracy": right.float().mean()}
        early = self.training and self.global_step < self.matching_steps
        output = self.network(batch.observation, matching_only=early)
        terms = correlation_losses(output, batch, self.network.config.radius, self.weights)
        loss = torch.stack(
            [value * getattr(self.weights, name) for name, value in terms.items()]
        ).sum()
        values = {name: value.detach() for name, value in terms.items()}
        delta = output.prediction.delta
        assert delta is not None
        values["error_left"] = (
            (delta - batch.delta).abs().sum() / batch.delta.abs().sum()
        ).detach()
        values["right"] = is_right(batch, point_error(batch, delta.detach())).mean()
        return loss, values

    def configure_optimizers(self) -> Any:
        """AdamW with warm-up and the chosen decay; without weight decay it is the paper's Adam."""
        optimizer = torch.optim.AdamW(
            self.network.parameters(), lr=self.learning_rate, weight_decay=self.weight_decay
        )
        scheduler = torch.optim.lr_scheduler.LambdaLR(optimizer, self._rate)
        return {
            "optimizer": optimizer,
            "lr_scheduler": {"scheduler": scheduler, "interval": "step"},
        }

    def _rate(self, step: int) -> float:
        start = min(1.0, (step + 1) / max(1, self.warmup_steps))
        if self.schedule == "paper":
            return float(start * 0.95 ** (step / 1000))
        share = min(1.0, step / self.total_steps)
        return float(start * max(0.02, 0.5 * (1 + math.cos(math.pi * share))))

    def export(self, path: Path, facts: dict[str, str]) -> None:
        """Write the network as a weights file that `moveit6d.load_policy` reads."""
        save_network(self.network, path, {**facts, "steps": str(self.global_step)})


def _network(
    network: CorrelationNet | ActionNet | None, init_from: Path | None
) -> CorrelationNet | ActionNet:
    """What to train, in training mode, which what is loaded is not."""
    if network is None:
        if init_from is None:
            raise InputError("Nothing to train: set model.network or model.init_from.")
        network = load_network(init_from).network
    elif init_from is not None:
        begin_from(network, init_from)
    return network.train()
