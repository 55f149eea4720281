"""The Lightning module that trains a network to move objects, object-specific or multi-object.

Never draws data. One class for both networks; the losses are in `losses`.
"""

from __future__ import annotations

import dataclasses
import math
import time
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import pytorch_lightning as pl
import torch
from pytorch_lightning.utilities import rank_zero_warn
from torch import Tensor, nn
from torch.nn.utils import convert_conv2d_weight_memory_format, get_total_norm

from moveit6d.actions import expert_action
from moveit6d.config.ranges import RANGES
from moveit6d.errors import InputError
from moveit6d.io import file_digest
from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.kinds import PoseNet
from moveit6d.networks.weights_file import begin_from, load_network, save_network
from moveit6d.policies import SHIPPED_WEIGHTS
from moveit6d.synthesis.training.pairs import TrainingBatch

from .distillation import Teacher, distillation_loss
from .losses import (
    LossWeights,
    action_losses,
    correlation_losses,
    view_loss,
    view_pictures,
)
from .pair_streams import check_leads

MOST_LEFT_OUT = 20  # steps in a row
PRECISIONS = ("32-true", "16-mixed", "bf16-mixed")  # that leave losses and weights in float32


class PoseActionModule(pl.LightningModule):
    """Trains any of `networks.kinds` on `TrainingBatch`es.

    A step whose gradients are not finite is left out: the network stays as it was before. A fit
    that goes on from a checkpoint has the learning rates and the weight decay that are set now.

    Args:
        network: the network to train; None: the one in `init_from`.
        learning_rate: at its peak, after `warmup_steps`.
        schedule: `cosine` to 2 % of the peak at `total_steps`; `stable_decay`: the peak, then in a
            line to 2 % over the last `decay` of them, so that a fit can be made longer while it
            runs; or `paper`: 5 % less every 1,000.
        total_steps: length of the schedule.
        restarts: steps at which the schedule begins anew, warm-up and all (Loshchilov and Hutter,
            SGDR, ICLR 2017): where a fit that had come to its end was made longer.
        decay: share of the schedule, or of each part of it, in which `stable_decay` goes down.
        minutes: length of the schedule in time, if that ends first: for machines that are lent.
            Counted from the step from which on it is set, also if the fit is killed and goes on.
        matching_steps: first steps in which only the matching reaches the encoder.
        weights: weights of the loss terms.
        teacher: weights file whose encoder that of a compact network imitates at first; None:
            nobody's.
        teacher_steps: steps in which the weight of that falls to nothing.
        init_from: weights file (.safetensors) to start from instead of random numbers, `shipped`
            for the one that comes with the package; of a network of the same sizes as `network` or
            a shallower one (`begin_from`), if there is one.
    """

    def __init__(
        self,
        network: PoseNet | None = None,
        learning_rate: float = 1.5e-3,
        schedule: str = "cosine",
        total_steps: int = 20_000,
        restarts: tuple[int, ...] = (),
        decay: float = 0.25,
        minutes: float | None = None,
        warmup_steps: int = 40,
        weight_decay: float = 1e-4,
        matching_steps: int = 500,
        weights: LossWeights | None = None,
        teacher: Path | None = None,
        teacher_steps: int = 8000,
        init_from: Literal["shipped"] | Path | None = None,
    ) -> None:
        super().__init__()
        schedules = ("cosine", "stable_decay", "paper")
        if schedule not in schedules:
            raise InputError(f"model.schedule is {schedule!r}, must be one of {schedules}.")
        _check_numbers("above 0 and finite", learning_rate=learning_rate)
        _check_numbers("1 or more", total_steps=total_steps)
        steps = {"warmup_steps": warmup_steps, "matching_steps": matching_steps}
        _check_numbers("0 or more and finite", weight_decay=weight_decay, **steps)
        if not 0 < decay <= 1:
            raise InputError(f"model.decay is {decay}, must be above 0 and 1 at most.")
        ends = (*restarts, total_steps)
        if restarts and any(end <= begin for begin, end in pairwise((0, *ends))):
            raise InputError(
                f"model.restarts is {list(restarts)}: its steps must go up, all of them between 0 "
                f"and model.total_steps ({total_steps})."
            )
        _check_lengths(minutes, teacher, teacher_steps)
        self.init_from = SHIPPED_WEIGHTS if init_from == "shipped" else init_from
        self.network = _network(network, self.init_from)
        self.teacher = None if teacher is None else Teacher(teacher, self.network)
        self.teacher_steps = teacher_steps
        convert_conv2d_weight_memory_format(self.network, torch.channels_last)  # faster on CPUs
        self.learning_rate, self.schedule = learning_rate, schedule
        self.ends, self.warmup_steps = ends, warmup_steps
        self.decay = decay
        self.minutes, self._begin = minutes, time.monotonic()
        self._minutes_before = 0.0  # of `minutes`, before the checkpoint that the fit goes on from
        self.weight_decay, self.matching_steps = weight_decay, matching_steps
        self.weights = weights or LossWeights()
        self.values: dict[str, Tensor] = {}  # terms of the last training step; none if left out
        self.left_out = 0  # steps in a row
        self._step = -1  # that the following two are of
        self._terms: list[dict[str, Tensor]] = []  # of each of its batches
        self._statistics: list[Tensor] = []  # of batch normalisation, before it

    def on_train_start(self) -> None:
        """Time counts from here; rates are the module's, not those that a checkpoint remembers."""
        self._begin, self._step = time.monotonic(), -1
        for optimizer in self.trainer.optimizers:
            for group in optimizer.param_groups:
                group["initial_lr"], group["weight_decay"] = self.learning_rate, self.weight_decay
        for one in self.trainer.lr_scheduler_configs:
            schedule: Any = one.scheduler
            schedule.base_lrs = [self.learning_rate] * len(schedule.base_lrs)
            for group in schedule.optimizer.param_groups:
                group["lr"] = self.learning_rate * self._rate(schedule.last_epoch)

    def on_save_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Add how much of `minutes` is over."""
        checkpoint["schedule"] = {"minutes": self.minutes, "over": self._minutes_over()}

    def on_load_checkpoint(self, checkpoint: dict[str, Any]) -> None:
        """Take the time over; `InputError` for the checkpoint of a network of other sizes."""
        mine, theirs = (
            {name: value.shape for name, value in state.items()}
            for state in (self.state_dict(), checkpoint["state_dict"])
        )
        if mine != theirs:
            raise InputError(
                "The checkpoint to go on from is of a network of other sizes than model.network: "
                "configure that as it was, or give another --output to begin anew."
            )
        known = checkpoint.get("schedule", {})
        same = known.get("minutes") == self.minutes
        self._minutes_before = known.get("over", 0.0) if same else 0.0

    def on_fit_start(self) -> None:
        """`InputError` if the network is not made for the pairs, or in such a precision."""
        if self.trainer.precision not in PRECISIONS:
            raise InputError(
                f"trainer.precision is {self.trainer.precision}, must be one of "
                f"{', '.join(PRECISIONS)}."
            )
        data = getattr(self.trainer, "datamodule", None)
        rollouts, pairs = getattr(data, "rollouts", None), getattr(data, "pairs", None)
        if rollouts is not None and rollouts.iterations and rollouts.weights is None:
            check_leads(self.network)
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
        if self._step != self.global_step:  # else another batch of a step that takes several
            self._step, self._terms = self.global_step, []
            self._statistics = [values.clone() for values in self._running()]
        loss, values = self._shared_step(batch)
        if not _near(batch.delta, batch).any():
            values.pop("error_left", None)  # of nothing: it would make means smaller
        self._terms.append(values)
        self.values = _means(self._terms)
        size = len(batch.delta)
        trainer: Any = self.trainer
        every = trainer.log_every_n_steps  # in these steps Lightning writes what it was given last
        if every and (self.global_step + 1) % every == 0:
            named = {f"train/{name}": value for name, value in self.values.items()}
            self.log_dict({"loss": loss, **named}, batch_size=size)
        return loss

    def configure_gradient_clipping(
        self,
        optimizer: torch.optim.Optimizer,
        gradient_clip_val: float | None = None,
        gradient_clip_algorithm: str | None = None,
    ) -> None:
        """Clip as the trainer says; with gradients that are not finite the step changes nothing.

        `InputError` after `MOST_LEFT_OUT` such steps in a row.
        """
        gradients = [p.grad for p in self.network.parameters() if p.grad is not None]
        if get_total_norm(gradients).isfinite():
            self.left_out = 0
            self.clip_gradients(optimizer, gradient_clip_val, gradient_clip_algorithm)
            return
        optimizer.zero_grad(set_to_none=True)  # so that not even the momentum moves anything
        for values, before in zip(self._running(), self._statistics, strict=True):
            values.copy_(before)
        bad = (k for batch in self._terms for k, v in batch.items() if not v.isfinite().all())
        terms = dict.fromkeys(bad)  # each once
        reason = f"{', '.join(terms)} not finite" if terms else "gradients not finite"
        rank_zero_warn(f"Step {self.global_step} is left out: {reason}.")
        self.values, self.left_out = {}, self.left_out + 1
        if self.left_out == MOST_LEFT_OUT:
            raise InputError(
                f"The fit has left out {MOST_LEFT_OUT} steps in a row, as their gradients are not "
                "finite: lower model.learning_rate and go on from a checkpoint or weights before."
            )

    def _running(self) -> list[Tensor]:
        """The statistics that batch normalisation keeps; of no other buffer, which stay."""
        parts = self.network.modules()
        return [b for part in parts if isinstance(part, nn.BatchNorm2d) for b in part.buffers()]

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
            prediction, logit = self.network(batch.observation)
            terms = action_losses(prediction, logit, batch)
            best = prediction.logits.argmax(-1) == expert_action(batch.delta)
            values = {name: value.detach() for name, value in terms.items()}
            values["accuracy"] = best.float().mean()
            return terms["actions"] + terms["confidence"], values
        early = self.training and self.global_step < self.matching_steps
        network, views = self.network, batch.views
        if isinstance(network, CompactCorrelationNet) and views is not None:
            output = network(batch.observation, early, view_pictures(views))
        else:
            output = network(batch.observation, early)
        terms, right = correlation_losses(output, batch, network.config.radius, self.weights)
        if output.described is not None:
            assert isinstance(network, CompactCorrelationNet) and views is not None
            temperature = network.view_temperature
            terms["views"] = view_loss(output.described, views, batch.mesh, temperature)
        if self.teacher is not None and output.features is not None and self.training:
            taught = 1 - self.global_step / self.teacher_steps
            if taught > 0:
                known = self.teacher.features(batch.observation)
                terms["teacher"] = distillation_loss(output.features, known) * taught
        loss = torch.stack(
            [value * getattr(self.weights, name) for name, value in terms.items()]
        ).sum()
        values = {name: value.detach() for name, value in terms.items()}
        delta = output.prediction.delta
        assert delta is not None
        left, whole = _near(delta - batch.delta, batch).sum(), _near(batch.delta, batch).sum()
        values["error_left"] = torch.where(whole > 0, left / whole, 0.0).detach()
        values["right"] = right.mean()
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
        begin = max([0, *(end for end in self.ends[:-1] if end <= step)])
        start = min(1.0, (step - begin + 1) / max(1, self.warmup_steps))
        if self.schedule == "paper":
            return float(start * 0.95 ** ((step - begin) / 1000))
        end = next((end for end in self.ends if end > begin), step + 1)
        share = min(1.0, (step - begin) / (end - begin))
        if self.minutes is not None:
            share = min(1.0, max(share, self._minutes_over() / self.minutes))
        if self.schedule == "stable_decay":
            return float(start * max(0.02, min(1.0, (1 - share) / self.decay)))
        return float(start * max(0.02, 0.5 * (1 + math.cos(math.pi * share))))

    def _minutes_over(self) -> float:
        return self._minutes_before + (time.monotonic() - self._begin) / 60

    def facts(self) -> dict[str, Any]:
        """What a fit that goes on cannot change of its network, by the options' names."""
        teacher = None if self.teacher is None else self.teacher.path
        files = {"init_from": self.init_from, "teacher": teacher}
        return {
            "model.network": type(self.network).__name__,
            "model.network.init_args.config": dataclasses.asdict(self.network.config),
            **{f"model.{k}": None if v is None else file_digest(v) for k, v in files.items()},
            "model.weights": dataclasses.asdict(self.weights),
        }

    def export(self, path: Path, facts: dict[str, str]) -> None:
        """Write the network as a weights file that `moveit6d.load_policy` reads."""
        save_network(self.network, path, {**facts, "steps": str(self.global_step)})


def _near(delta: Tensor, batch: TrainingBatch) -> Tensor:
    """Absolute pose deltas (B, 6), 0 for pairs that teach none."""
    return delta.abs() * batch.near[:, None]


def _means(batches: list[dict[str, Tensor]]) -> dict[str, Tensor]:
    """Of every term, over the batches that have it."""
    if len(batches) == 1:  # nearly always: no work in every step
        return batches[0]
    names = dict.fromkeys(name for batch in batches for name in batch)
    known = {name: [batch[name] for batch in batches if name in batch] for name in names}
    return {name: torch.stack(values).mean(0) for name, values in known.items()}


def _check_numbers(what: str, **numbers: float) -> None:
    """`InputError` for one outside of a range of `RANGES`."""
    for name, value in numbers.items():
        if not RANGES[what](value):
            raise InputError(f"model.{name} is {value}, must be {what}.")


def _check_lengths(minutes: float | None, teacher: Path | None, teacher_steps: int) -> None:
    if minutes is not None and not minutes > 0:
        raise InputError(f"model.minutes is {minutes}, must be above 0 (null: no such end).")
    if teacher is not None and teacher_steps < 1:
        raise InputError(
            f"model.teacher_steps is {teacher_steps}, must be 1 or more; set model.teacher to null "
            "to learn from none."
        )


def _network(network: PoseNet | None, init_from: Path | None) -> PoseNet:
    """What to train, in training mode, which what is loaded is not."""
    if network is None:
        if init_from is None:
            raise InputError("Nothing to train: set model.network or model.init_from.")
        network = load_network(init_from).network
    elif init_from is not None:
        begin_from(network, init_from)
    return network.train()
