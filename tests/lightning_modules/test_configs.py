"""The configurations: the paper's training in its numbers, overlays, and what they are read by."""

import dataclasses
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import torch
import yaml
from PIL import Image

from lightning_modules.bank_pairs import BankStream
from lightning_modules.cli import read_data
from lightning_modules.pose_action_module import PoseActionModule
from moveit6d.networks.action_net import ActionConfig, ActionNet
from moveit6d.synthesis.augmentation.config import AugmentConfig
from moveit6d.synthesis.augmentation.lights import LightConfig
from moveit6d.synthesis.augmentation.occluder_bank import BankConfig
from moveit6d.synthesis.training.pairs import PairConfig
from tests.support.pairs import CONFIGS, photos, preset

ROOT = CONFIGS.parent
FITS = sorted((CONFIGS / "fit").glob("*.yaml"))
GPU_PAIRS = CONFIGS / "overlay" / "gpu_pairs.yaml"  # instead of the others, not beside them
OVERLAYS = [one for one in sorted((CONFIGS / "overlay").glob("*.yaml")) if one != GPU_PAIRS]


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("path", FITS, ids=lambda path: path.stem)
def test_every_configuration_is_read_with_every_overlay(path: Path) -> None:
    overlays = OVERLAYS
    if path.stem == "my_object":  # the network is that of its weights file
        overlays = [one for one in OVERLAYS if one.stem not in ("no_depth", "axis_parallel")]
    data = read_data([f"--config={one}" for one in (path, *overlays)])
    assert data.batch_size == 16 and data.workers == 8, "ddp.yaml's and gpu.yaml's"
    if path.stem in ("object_specific", "multi_object"):
        paper = preset("paper")
        changed = dataclasses.replace(paper, crop="axis_parallel")
        assert data.pairs == changed, "but for the overlay's crop"
    if path.stem == "object_specific":
        assert (data.holdout, data.shapes, data.renew_every) == (0, 0, 0)
        assert data.source().shapes == 1, "without meshes one procedural object, which stays"


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("path", FITS, ids=lambda path: path.stem)
def test_a_fit_s_pairs_can_be_looked_at_from_any_folder(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # where neither a teacher nor any other weights are
    assert read_data([f"--config={path}"]).validation_batches == 8


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("name", ["compact", "multi_object_correlation", "my_object"])
def test_on_a_cpu_rollouts_begin_with_the_first_weights_that_the_fit_writes(name: str) -> None:
    data = read_data([f"--config={CONFIGS / 'fit' / name}.yaml"])
    assert data.rollouts.iterations > 0 and data.rollouts.first_step == 0


def test_one_s_own_object_begins_with_the_shipped_weights_from_any_folder() -> None:
    text = (CONFIGS / "fit" / "my_object.yaml").read_text(encoding="utf-8")
    assert yaml.safe_load(text)["model"]["init_from"] == "shipped"


@pytest.mark.filterwarnings("ignore")
def test_a_gpu_can_draw_the_pairs_itself() -> None:
    data = read_data([f"--config={CONFIGS / 'fit' / 'compact.yaml'}", f"--config={GPU_PAIRS}"])
    assert (data.device, data.workers, data.batch_size) == ("cuda", 0, 512)
    assert data.pairs == preset("linear_light")
    assert (data.rollouts.iterations, data.rollouts.first_step) == (2, 600)
    assert isinstance(data.train_dataloader().dataset, BankStream), "no option of it is refused"


def keys(values: Any) -> Any:
    """The names in a nested dictionary."""
    return {name: keys(one) for name, one in values.items()} if isinstance(values, dict) else None


@pytest.mark.parametrize("name", ["paper", "realistic", "linear_light"])
def test_presets_name_every_value_so_that_one_replaces_the_other(name: str) -> None:
    found = yaml.safe_load((CONFIGS / "pairs" / f"{name}.yaml").read_text(encoding="utf-8"))
    assert keys(found) == keys(dataclasses.asdict(PairConfig()))


def test_the_shipped_model_s_defaults_are_the_realistic_ones_but_for_what_is_new() -> None:
    new = preset("realistic")
    old, default = new.augment, AugmentConfig()
    names = [item.name for item in dataclasses.fields(old)]
    differ = {name for name in names if getattr(old, name) != getattr(default, name)}
    assert differ == {
        "background_blur",
        "lens_error",
        "downsampling",
        "calibration_board",
        "clutter",
    }
    assert new.lights == LightConfig() and new.bank == BankConfig()


@pytest.mark.filterwarnings("ignore")
def test_presets_are_chosen_and_overridden_by_name() -> None:
    """The file's values all go; what is named after it stays."""
    fit = f"--config={CONFIGS / 'fit' / 'multi_object.yaml'}"
    realistic = f"--data.pairs={CONFIGS / 'pairs' / 'realistic.yaml'}"
    found = read_data([fit, realistic, "--data.pairs.hands.probability=0.5"]).pairs
    assert found.hands.probability == 0.5
    hands = preset("realistic").hands
    assert dataclasses.replace(found, hands=hands) == preset("realistic")


def test_the_paper_s_optimizer() -> None:
    """Adam 1e-4, five percent less every 1,000 steps."""
    module = PoseActionModule(
        ActionNet(ActionConfig(channels=(4, 4, 4, 4), hidden=4)),
        learning_rate=1e-4,
        schedule="paper",
        warmup_steps=0,
        weight_decay=0.0,
    )
    made = module.configure_optimizers()
    (group,) = made["optimizer"].param_groups
    assert group["weight_decay"] == 0.0 and group["betas"] == (0.9, 0.999)
    assert group["lr"] == pytest.approx(1e-4)
    rates = [1e-4 * module._rate(step) for step in (0, 1000, 2000, 25_000)]
    assert rates == pytest.approx([1e-4, 0.95e-4, 0.9025e-4, 1e-4 * 0.95**25])


def test_without_weight_decay_adamw_is_adam() -> None:
    start = torch.tensor([1.0, -2.0])
    ends = []
    for kind in (torch.optim.Adam, torch.optim.AdamW):
        value = start.clone().requires_grad_()
        optimizer = kind([value], lr=0.1, weight_decay=0.0)
        for _ in range(3):
            optimizer.zero_grad()
            value.pow(4).sum().backward()
            optimizer.step()
        ends.append(value.detach())
    assert torch.allclose(*ends)


def test_two_processes_train_together_each_on_its_own_pairs(tmp_path: Path) -> None:
    """With the overlay's strategy, forked here instead of started as a script again."""
    pictures = tmp_path / "photos"
    pictures.mkdir()
    Image.fromarray(photos()[0]).save(pictures / "0.png")
    words = [
        f"--config={CONFIGS / 'fit' / 'multi_object.yaml'}",
        f"--config={CONFIGS / 'overlay' / 'cpu.yaml'}",
        f"--config={CONFIGS / 'overlay' / 'ddp.yaml'}",
        "--trainer.strategy=ddp_fork_find_unused_parameters_true",
        "--trainer.max_steps=2",
        "--model.network.init_args.config={channels: [4, 4, 4, 4], hidden: 4}",
        "--data.shapes=1",
        "--data.workers=0",
        "--data.batch_size=2",
        "--data.validation_batches=1",
        "--data.pairs.bank.new_per_batch=1",
        f"--data.photos={pictures}",
        "--trainer.callbacks=tests.support.recorder.PairRecorder",
        f"--trainer.callbacks.folder={tmp_path}",
        f"--output={tmp_path}",
        "--trainer.val_check_interval=2",
    ]
    code = "import sys; from lightning_modules.cli import main; main(sys.argv[1:])"
    paths = os.pathsep.join([str(ROOT), str(ROOT / "lib")])
    done = subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=tmp_path,
        capture_output=True,
        text=True,
        env={**os.environ, "PYTHONPATH": paths, "OMP_NUM_THREADS": "1"},
        timeout=600,
    )
    assert done.returncode == 0, done.stderr[-3000:]
    ranks = [torch.load(tmp_path / f"rank{rank}.pt") for rank in (0, 1)]
    for first, second in zip(ranks[0]["delta"], ranks[1]["delta"], strict=True):
        assert not torch.equal(first, second)
    assert len(ranks[0]["delta"]) == 2
    assert ranks[0]["weights"].abs().sum() > 0
    assert torch.equal(ranks[0]["weights"], ranks[1]["weights"]), "one network in both"
