"""A fit leaves one checkpoint, and the weights beside it, of its end, however it ends."""

from pathlib import Path

import pytest
import pytorch_lightning as pl
import torch

from lightning_modules.callbacks import FigureLine, LastCheckpoint, WeightsExport
from lightning_modules.pair_data_module import PairDataModule
from lightning_modules.pose_action_module import PoseActionModule
from moveit6d.errors import InputError
from moveit6d.networks.action_net import ActionConfig, ActionNet
from moveit6d.networks.weights_file import load_network
from moveit6d.synthesis.training.source import PairSource

pytestmark = pytest.mark.filterwarnings("ignore::UserWarning")


class _StopAt(pl.Callback):
    """Presses Ctrl-C after a step, or raises what else is wanted."""

    def __init__(self, step: int, error: type[BaseException]) -> None:
        self.step, self.error = step, error

    def on_train_batch_end(self, trainer: pl.Trainer, *_: object) -> None:
        if trainer.global_step == self.step:
            raise self.error


def fit(
    source: PairSource, folder: Path, steps: int, *others: pl.Callback, batches: int = 1
) -> pl.Trainer:
    """So many steps with a checkpoint after every second one, from the last one if there is one."""
    kept = LastCheckpoint(
        folder, every_n_train_steps=2, save_last=True, save_top_k=0, save_on_exception=True,
        enable_version_counter=False,
    )  # fmt: skip
    trainer = pl.Trainer(
        max_steps=steps,
        accelerator="cpu",
        logger=False,
        callbacks=[*others, kept],
        enable_progress_bar=False,
        limit_val_batches=0,
        accumulate_grad_batches=batches,
        default_root_dir=folder,
    )
    module = PoseActionModule(ActionNet(ActionConfig(channels=(4, 4, 4, 4), hidden=4)))
    data = PairDataModule(photos=source.photos, shapes=1, batch_size=2, workers=0)
    trainer.fit(module, data, ckpt_path="last" if folder.exists() else None)
    return trainer


def step_of(folder: Path) -> int:
    (only,) = folder.iterdir()
    assert only.name == "last.ckpt"
    return int(torch.load(only, weights_only=True)["global_step"])


def test_the_end_is_kept_and_gone_on_from(source: PairSource, tmp_path: Path) -> None:
    folder = tmp_path / "fit"
    fit(source, folder, 3)
    assert step_of(folder) == 3
    assert fit(source, folder, 5).global_step == 5
    assert step_of(folder) == 5


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_where_it_is_interrupted_is_kept_alone(
    source: PairSource, tmp_path: Path, error: type[BaseException]
) -> None:
    folder = tmp_path / "fit"
    with pytest.raises((SystemExit, error)):  # Lightning's answer to Ctrl-C
        fit(source, folder, 9, _StopAt(3, error))
    assert step_of(folder) == 3


# -- weights and figures ---------------------------------------------------------------------------


@pytest.mark.parametrize("error", [KeyboardInterrupt, ValueError])
def test_weights_are_those_of_the_checkpoint(
    source: PairSource, tmp_path: Path, error: type[BaseException]
) -> None:
    with pytest.raises((SystemExit, error)):
        fit(source, tmp_path / "fit", 9, WeightsExport(tmp_path, 2), _StopAt(3, error))
    assert step_of(tmp_path / "fit") == 3
    assert load_network(tmp_path / "weights.safetensors").facts["steps"] == "3"


def test_each_step_is_exported_and_printed_once_and_none_before_the_first(
    source: PairSource,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    exported: list[int] = []
    monkeypatch.setattr(
        PoseActionModule, "export", lambda self, *_: exported.append(self.global_step)
    )
    folder = tmp_path / "fit"
    fit(source, folder, 4, WeightsExport(tmp_path, 2), FigureLine(2), batches=3)
    assert exported == [2, 4]
    lines = [line.split()[1] for line in capsys.readouterr().out.splitlines() if "min:" in line]
    assert lines == ["2", "4"]
    figures = FigureLine(3)
    fit(source, folder, 5, WeightsExport(tmp_path, 2), figures, batches=3)
    assert exported == [2, 4, 4, 5] and figures.sums["actions"][1] == 1, "of step 5 alone"


def test_a_fit_that_was_interrupted_before_its_first_step_exports_nothing(
    source: PairSource, tmp_path: Path
) -> None:
    with pytest.raises(ValueError, match=r"^$"):
        fit(source, tmp_path / "fit", 9, WeightsExport(tmp_path), _StopAt(0, ValueError), batches=2)
    assert not (tmp_path / "weights.safetensors").exists()


@pytest.mark.parametrize("steps", [0, -1])
def test_every_so_many_steps_is_every_step_or_fewer(tmp_path: Path, steps: int) -> None:
    with pytest.raises(InputError, match=rf"export\.every_n_steps is {steps}, must be 1 or more"):
        WeightsExport(tmp_path, steps)
    with pytest.raises(InputError, match=rf"figures\.every_n_steps is {steps}, must be 1 or more"):
        FigureLine(steps)
