"""The module: what it starts from."""

from pathlib import Path

import pytest
import pytorch_lightning as pl
import torch

from lightning_modules import pose_action_module
from lightning_modules.pair_data_module import PairDataModule
from lightning_modules.pose_action_module import PoseActionModule
from moveit6d.errors import InputError
from moveit6d.networks.action_net import ActionConfig, ActionNet
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
from moveit6d.networks.weights_file import save_network


def test_a_fit_from_weights_has_them_and_trains_every_layer(tmp_path: Path) -> None:
    torch.manual_seed(0)
    known = CorrelationNet()
    save_network(known, tmp_path / "known.safetensors")
    module = PoseActionModule(CorrelationNet(), init_from=tmp_path / "known.safetensors")
    for name, value in module.network.state_dict().items():
        assert torch.equal(value, known.state_dict()[name]), name
    # Batch normalisation that is left in evaluation mode would never follow the new pictures.
    assert all(part.training for part in module.network.modules())


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


def test_a_fit_from_weights_alone_trains_the_network_that_they_are_of(tmp_path: Path) -> None:
    save_network(CorrelationNet(CorrelationConfig(context=40)), tmp_path / "known.safetensors")
    module = PoseActionModule(init_from=tmp_path / "known.safetensors")
    assert module.network.config == CorrelationConfig(context=40)
    assert all(part.training for part in module.network.modules())


def test_a_fit_of_nothing_is_refused() -> None:
    with pytest.raises(InputError, match=r"set model\.network or model\.init_from"):
        PoseActionModule()


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


@pytest.mark.parametrize("minutes", [0.0, -1.0, float("nan")])
def test_a_schedule_of_no_time_is_refused(minutes: float) -> None:
    with pytest.raises(InputError, match=r"model\.minutes is .*, must be above 0"):
        PoseActionModule(ActionNet(), minutes=minutes)


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
