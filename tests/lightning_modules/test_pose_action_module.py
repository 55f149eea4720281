"""The module: what it starts and goes on from, its rates, and what it logs."""

import csv
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import pytorch_lightning as pl
import torch

from lightning_modules import pose_action_module
from lightning_modules.losses import LossWeights, action_loss, is_right, point_error
from lightning_modules.pair_data_module import PairDataModule
from lightning_modules.pair_streams import RolloutConfig
from lightning_modules.pose_action_module import PoseActionModule
from moveit6d.actions import PoseAction
from moveit6d.errors import InputError
from moveit6d.networks.action_net import ActionConfig, ActionNet
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
from moveit6d.networks.weights_file import load_network, save_network
from moveit6d.policies import SHIPPED_WEIGHTS
from moveit6d.synthesis.training.pairs import TrainingBatch
from moveit6d.synthesis.training.source import PairSource


def test_a_fit_from_weights_has_them_and_trains_every_layer(tmp_path: Path) -> None:
    torch.manual_seed(0)
    known = CorrelationNet()
    save_network(known, tmp_path / "known.safetensors")
    module = PoseActionModule(CorrelationNet(), init_from=tmp_path / "known.safetensors")
    for name, value in module.network.state_dict().items():
        assert torch.equal(value, known.state_dict()[name]), name
    # Batch normalisation that is left in evaluation mode would never follow the new pictures.
    assert all(part.training for part in module.network.modules())


def test_the_shipped_weights_have_a_name() -> None:
    module = PoseActionModule(init_from="shipped")
    known = load_network(SHIPPED_WEIGHTS).network.state_dict()
    for name, value in module.network.state_dict().items():
        assert torch.equal(value, known[name]), name


def test_pairs_of_other_crops_than_the_networks_are_refused() -> None:
    module = PoseActionModule(ActionNet(ActionConfig(crop="axis_parallel")))
    data = PairDataModule(shapes=1, workers=0)
    trainer = pl.Trainer(
        max_steps=1,
        accelerator="cpu",
        logger=False,
        enable_checkpointing=False,
        enable_progress_bar=False,
        limit_val_batches=0,
    )
    with pytest.raises(InputError, match="look_at crops, the network is made for axis_parallel"):
        trainer.fit(module, data)


@pytest.mark.parametrize("device", ["cpu", "cuda"])
def test_rollouts_of_a_network_of_single_actions_are_refused_before_the_first_step(
    monkeypatch: pytest.MonkeyPatch, device: Any
) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: device == "cuda")
    module = PoseActionModule(small())
    data = PairDataModule(workers=0, rollouts=RolloutConfig(None, 2), device=device)
    trainer = pl.Trainer(max_steps=1, accelerator="cpu", logger=False, enable_checkpointing=False)
    with pytest.raises(InputError, match=r"all six axes.*data\.rollouts\.iterations to 0"):
        trainer.fit(module, data)


def test_a_fit_from_weights_alone_trains_the_network_that_they_are_of(tmp_path: Path) -> None:
    save_network(CorrelationNet(CorrelationConfig(context=40)), tmp_path / "known.safetensors")
    module = PoseActionModule(init_from=tmp_path / "known.safetensors")
    assert module.network.config == CorrelationConfig(context=40)
    assert all(part.training for part in module.network.modules())


def test_a_fit_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match=r"set model\.network or model\.init_from"):
        PoseActionModule()


def small() -> ActionNet:
    return ActionNet(ActionConfig(channels=(4, 4, 4, 4), hidden=4))


def trained(
    module: PoseActionModule,
    source: PairSource,
    steps: int,
    start: Path | None = None,
    **options: Any,
) -> pl.Trainer:
    """A few steps, maybe from a checkpoint."""
    options = {"logger": False, **options}
    trainer = pl.Trainer(
        max_steps=steps,
        accelerator="cpu",
        enable_checkpointing=False,
        enable_progress_bar=False,
        limit_val_batches=0,
        **options,
    )
    data = PairDataModule(photos=source.photos, shapes=1, batch_size=2, workers=0)
    trainer.fit(module, data, ckpt_path=start)
    return trainer


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_fit_goes_on_with_the_rates_that_are_set_now(source: PairSource, tmp_path: Path) -> None:
    def module(rate: float, decay: float) -> PoseActionModule:
        return PoseActionModule(
            small(), learning_rate=rate, weight_decay=decay, schedule="paper", warmup_steps=0
        )

    checkpoint = tmp_path / "any.ckpt"
    trained(module(1e-3, 1e-4), source, 2).save_checkpoint(checkpoint)
    seen: list[tuple[float, float]] = []

    class Watch(pl.Callback):
        def on_before_optimizer_step(self, _: Any, __: Any, optimizer: Any) -> None:
            (group,) = optimizer.param_groups
            seen.append((group["lr"], group["weight_decay"]))

    trained(module(5e-4, 0.0), source, 4, checkpoint, callbacks=[Watch()])
    assert [rate for rate, _ in seen] == pytest.approx([5e-4 * 0.95**0.002, 5e-4 * 0.95**0.003])
    assert [decay for _, decay in seen] == [0.0, 0.0]


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_fit_that_goes_on_unchanged_is_the_fit_that_went_through(
    source: PairSource, tmp_path: Path
) -> None:
    """In its rates: the pairs are others on purpose."""

    def rates(steps: int, start: Path | None = None) -> list[float]:
        found: list[float] = []

        class Watch(pl.Callback):
            def on_before_optimizer_step(self, _: Any, __: Any, optimizer: Any) -> None:
                found.append(optimizer.param_groups[0]["lr"])

        module = PoseActionModule(small(), total_steps=8, warmup_steps=3)
        trainer = trained(module, source, steps, start, callbacks=[Watch()])
        trainer.save_checkpoint(tmp_path / f"{steps}.ckpt")
        return found

    through = rates(6)
    assert rates(4) + rates(6, tmp_path / "4.ckpt") == through


def test_time_goes_on_where_it_was_unless_it_is_set_anew(
    source: PairSource, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "monotonic", lambda: now[0])

    def module(minutes: float | None) -> PoseActionModule:
        return PoseActionModule(small(), minutes=minutes, total_steps=1000, warmup_steps=0)

    checkpoint: dict[str, Any] = {}
    first = module(2.0)
    now[0] += 60
    first.on_save_checkpoint(checkpoint)
    assert first._rate(0) == pytest.approx(0.5)
    now[0] += 1000  # killed; later
    checkpoint["state_dict"] = first.state_dict()
    for minutes, over in ((2.0, 1.0), (3.0, 0.0)):
        again = module(minutes)
        again.on_load_checkpoint(checkpoint)
        assert again._minutes_over() == pytest.approx(over)
    again.on_load_checkpoint({"state_dict": first.state_dict()})  # of an earlier version
    assert again._minutes_over() == 0.0


def test_a_checkpoint_of_other_sizes_is_refused() -> None:
    other = PoseActionModule(ActionNet(ActionConfig(channels=(4, 4, 4, 4), hidden=8)))
    with pytest.raises(InputError, match=r"network of other sizes than model\.network"):
        PoseActionModule(small()).on_load_checkpoint({"state_dict": other.state_dict()})


def test_what_is_logged_is_of_the_step_that_it_is_written_for(
    source: PairSource, tmp_path: Path
) -> None:
    losses: list[float] = []

    class Watch(pl.Callback):
        def on_train_batch_end(self, _: Any, module: Any, *__: Any) -> None:
            losses.append(float(module.values["actions"]))

    logger = pl.loggers.CSVLogger(tmp_path, flush_logs_every_n_steps=1)
    trained(
        PoseActionModule(small()), source, 5, logger=logger, log_every_n_steps=2,
        callbacks=[Watch()],
    )  # fmt: skip
    (table,) = tmp_path.rglob("metrics.csv")
    with table.open() as file:
        rows = {int(row["step"]): float(row["train/actions"]) for row in csv.DictReader(file)}
    assert rows == pytest.approx({1: losses[1], 3: losses[3]})


def test_facts_are_of_the_network_and_what_it_begins_from(tmp_path: Path) -> None:
    known = tmp_path / "known.safetensors"
    save_network(small(), known)
    facts = PoseActionModule(small()).facts()
    rates = {"learning_rate": 1.0, "total_steps": 3, "schedule": "paper", "weight_decay": 0.0}
    assert PoseActionModule(small(), **rates).facts() == facts
    assert PoseActionModule(small(), init_from=known).facts() != facts
    shown_less = ActionConfig(channels=(4, 4, 4, 4), hidden=4, use_depth=False)
    assert PoseActionModule(ActionNet(shown_less)).facts() != facts
    assert PoseActionModule(small(), weights=LossWeights(matching=0.1)).facts() != facts


class _BrokenAt(pl.Callback):
    """Makes a parameter's gradient infinite in some steps."""

    def __init__(self, *steps: int) -> None:
        self.steps = steps
        self.states: list[dict[str, torch.Tensor]] = []

    def on_after_backward(self, trainer: pl.Trainer, pl_module: pl.LightningModule) -> None:
        if trainer.global_step in self.steps:
            gradient = next(p.grad for p in pl_module.parameters() if p.grad is not None)
            gradient.fill_(float("inf"))

    def on_train_batch_end(
        self, trainer: pl.Trainer, pl_module: pl.LightningModule, *_: object
    ) -> None:
        state = pl_module.state_dict()
        self.states.append({name: value.clone() for name, value in state.items()})


def _fit(broken: _BrokenAt, steps: int) -> PoseActionModule:
    torch.manual_seed(0)
    module = PoseActionModule(ActionNet(), learning_rate=1e-4)
    trainer = pl.Trainer(
        max_steps=steps,
        accelerator="cpu",
        logger=False,
        callbacks=[broken],
        enable_checkpointing=False,
        enable_progress_bar=False,
        limit_val_batches=0,
        gradient_clip_val=1.0,
    )
    trainer.fit(module, PairDataModule(shapes=1, batch_size=2, workers=0))
    return module


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_step_without_finite_gradients_leaves_the_network_as_it_was() -> None:
    broken = _BrokenAt(1)
    module = _fit(broken, 3)
    before, same, after = broken.states
    assert all(torch.equal(value, same[name]) for name, value in before.items())
    assert not all(torch.equal(value, after[name]) for name, value in before.items())
    assert module.left_out == 0 and module.values


class _Blinded(PoseActionModule):
    """Is shown one batch, by its number, without a finite number in its picture."""

    def training_step(self, batch: TrainingBatch, number: int) -> torch.Tensor:
        if number == 2:
            seen = batch.observation
            batch = replace(batch, observation=replace(seen, image=seen.image * float("nan")))
        return super().training_step(batch, number)


def test_a_bad_batch_among_those_of_a_step_leaves_the_network_as_it_was(
    source: PairSource,
) -> None:
    config = ActionConfig(channels=(4, 4, 4, 4), hidden=4)
    broken = _BrokenAt()
    with pytest.warns(UserWarning, match=r"Step 1 is left out: actions, confidence not finite"):
        trained(
            _Blinded(ActionNet(config)), source, 3, callbacks=[broken], accumulate_grad_batches=2
        )
    before, same, after = broken.states[1::2]
    assert all(torch.equal(value, same[name]) for name, value in before.items())
    assert all(value.isfinite().all() for value in after.values())
    assert not all(torch.equal(value, after[name]) for name, value in before.items())


def test_terms_of_a_step_are_means_of_its_batches(source: PairSource) -> None:
    alone: list[torch.Tensor] = []
    both: list[torch.Tensor] = []

    class Watch(pl.Callback):
        def on_train_batch_end(self, _: Any, module: Any, *__: Any) -> None:
            alone.append(module._terms[-1]["actions"])
            both.append(module.values["actions"])

    trained(PoseActionModule(small()), source, 1, callbacks=[Watch()], accumulate_grad_batches=2)
    assert both[0] == alone[0] and both[1] == pytest.approx(sum(map(float, alone)) / 2)


@pytest.mark.parametrize("pairs", [{"near": 0.0}, {"delta": 0.0}])
def test_a_batch_that_teaches_no_pose_delta_says_nothing_of_what_is_left(
    source: PairSource, pairs: dict[str, float]
) -> None:
    data = PairDataModule(photos=source.photos, shapes=1, batch_size=1, workers=0)
    batch = next(iter(data.train_dataloader()))
    batch = replace(batch, **{k: torch.full_like(getattr(batch, k), v) for k, v in pairs.items()})
    module = PoseActionModule(CompactCorrelationNet())
    module._trainer = pl.Trainer(logger=False, accelerator="cpu", enable_checkpointing=False)
    assert module._shared_step(batch)[1]["error_left"] == 0
    module.training_step(batch, 0)
    assert "error_left" not in module.values and module.values["delta"].isfinite()


@pytest.mark.filterwarnings("ignore::UserWarning")
def test_a_fit_of_which_every_step_is_left_out_ends_with_a_sentence(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(pose_action_module, "MOST_LEFT_OUT", 2)
    with pytest.raises(InputError, match="left out 2 steps in a row"):
        _fit(_BrokenAt(0, 1, 2), 3)


def test_a_schedule_begins_anew_at_its_restarts() -> None:
    parts = PoseActionModule(
        ActionNet(), schedule="stable_decay", total_steps=300, restarts=(100,), decay=0.5,
        warmup_steps=10,
    )  # fmt: skip
    alone = PoseActionModule(
        ActionNet(), schedule="stable_decay", total_steps=200, decay=0.5, warmup_steps=10
    )
    assert parts._rate(99) == pytest.approx(0.02)
    assert parts._rate(100) == pytest.approx(0.1)  # warming up
    assert parts._rate(150) == 1.0
    assert [parts._rate(100 + step) for step in range(201)] == [
        alone._rate(step) for step in range(201)
    ]


@pytest.mark.parametrize("restarts", [(0,), (300,), (200, 100)])
def test_restarts_outside_of_the_schedule_are_refused(restarts: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match=r"model\.restarts .* between 0 and model\.total_steps"):
        PoseActionModule(ActionNet(), total_steps=300, restarts=restarts)


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [
        ("learning_rate", -1.0, "above 0 and finite"),
        ("learning_rate", float("nan"), "above 0 and finite"),
        ("total_steps", 0, "1 or more"),
        ("total_steps", -5, "1 or more"),
        ("warmup_steps", -3, "0 or more and finite"),
        ("weight_decay", -1e-4, "0 or more and finite"),
        ("matching_steps", -1, "0 or more and finite"),
    ],
)
def test_numbers_that_no_fit_has_are_refused(option: str, value: float, words: str) -> None:
    with pytest.raises(InputError, match=rf"model\.{option} is {value}, must be {words}\."):
        PoseActionModule(ActionNet(), **{option: value})


@pytest.mark.parametrize("precision", ["bf16-true", "64-true"])
@pytest.mark.filterwarnings("ignore::UserWarning")
def test_precisions_in_which_no_network_is_trained_are_refused(
    source: PairSource, precision: str
) -> None:
    with pytest.raises(InputError, match=rf"trainer\.precision is {precision}, must be one of 32"):
        trained(PoseActionModule(small()), source, 1, precision=precision)


@pytest.mark.parametrize("minutes", [0.0, -1.0, float("nan")])
def test_a_schedule_of_no_time_is_refused(minutes: float) -> None:
    with pytest.raises(InputError, match=r"model\.minutes is .*, must be above 0"):
        PoseActionModule(ActionNet(), minutes=minutes)


def test_a_teacher_that_is_not_there_is_one_sentence() -> None:
    with pytest.raises(
        InputError, match=r"model\.teacher: nobody\.safetensors does not exist.*null"
    ):
        PoseActionModule(CompactCorrelationNet(), teacher=Path("nobody.safetensors"))


def test_a_teacher_of_no_steps_is_refused_and_without_one_nobody_counts_them(
    tmp_path: Path,
) -> None:
    known = tmp_path / "known.safetensors"
    save_network(CorrelationNet(), known)
    with pytest.raises(InputError, match=r"model\.teacher_steps is 0.*set model\.teacher to null"):
        PoseActionModule(CompactCorrelationNet(), teacher=known, teacher_steps=0)
    batch = next(iter(PairDataModule(shapes=1, batch_size=2, workers=0).val_dataloader()))
    loss, values = PoseActionModule(CompactCorrelationNet(), teacher_steps=0)._shared_step(batch)
    assert loss.isfinite() and "teacher" not in values


def test_the_papers_network_learns_its_confidence_and_its_actions_as_without_it() -> None:
    torch.manual_seed(0)
    module = PoseActionModule(ActionNet(ActionConfig(channels=(8, 8, 16, 16), hidden=32)))
    batch = next(iter(PairDataModule(shapes=1, batch_size=4, workers=0).val_dataloader()))
    prediction, _ = module.network(batch.observation)
    action_loss(prediction, batch).backward()
    alone = {name: p.grad.clone() for name, p in module.network.named_parameters()}
    module.zero_grad()
    loss, values = module._shared_step(batch)
    loss.backward()
    confidence = alone.pop("classifier.2.weight"), alone.pop("classifier.2.bias")
    last = module.network.classifier[-1]
    for found, before in zip((last.weight.grad, last.bias.grad), confidence, strict=True):
        assert torch.equal(found[:13], before[:13])
        assert before[13].abs().max() == 0 and found[13].abs().max() > 0
    parameters = dict(module.network.named_parameters())
    assert all(torch.equal(parameters[name].grad, before) for name, before in alone.items())
    moved = PoseAction.from_index(prediction.logits.argmax(-1)).delta
    right = is_right(batch, point_error(batch, moved))
    expected = torch.nn.functional.binary_cross_entropy(prediction.confidence, right).detach()
    torch.testing.assert_close(values["confidence"], expected)
