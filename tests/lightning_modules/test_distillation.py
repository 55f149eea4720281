"""An encoder that learns from another: what the loss is of the same and of unrelated features."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from lightning_modules.distillation import Teacher, distillation_loss
from lightning_modules.pair_data_module import PairDataModule
from lightning_modules.pose_action_module import PoseActionModule
from moveit6d.errors import InputError
from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
from moveit6d.networks.weights_file import save_network


def features(seed: int) -> tuple[torch.Tensor, torch.Tensor]:
    random = torch.Generator().manual_seed(seed)
    four, eight = (torch.randn(6, c, s, s, generator=random) for c, s in ((32, 32), (64, 16)))
    return four, eight


def test_the_loss_is_nothing_for_the_same_and_ignores_what_matching_ignores() -> None:
    four, eight = features(0)
    assert float(distillation_loss((four, eight), (four, eight))) == pytest.approx(0, abs=1e-6)
    # The mean and the length of stride 8's features do not matter to the correlation.
    same = float(distillation_loss((four, 3 * eight + 7), (four, eight)))
    assert same == pytest.approx(0, abs=1e-5)
    assert float(distillation_loss(features(1), (four, eight))) == pytest.approx(3, abs=0.1)


def test_a_network_in_training_comes_nearer_to_its_teacher(tmp_path: Path) -> None:
    torch.manual_seed(0)
    save_network(CorrelationNet(), tmp_path / "known.safetensors")
    data = PairDataModule(shapes=1, workers=0, batch_size=8, holdout=0, validation_batches=1)
    batch = next(iter(data.val_dataloader()))
    module = PoseActionModule(
        CompactCorrelationNet(), teacher=tmp_path / "known.safetensors", matching_steps=0
    )
    optimizer = torch.optim.Adam(module.network.parameters(), 3e-3)
    far = []
    for _ in range(8):
        loss, values = module._shared_step(batch)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        far.append(float(values["teacher"]))
    assert far[-1] < 0.8 * far[0]
    assert not any("teacher" in name for name in module.state_dict())
    module.eval()
    assert "teacher" not in module._shared_step(batch)[1]


def test_encoders_of_other_sizes_and_other_networks_are_refused(tmp_path: Path) -> None:
    save_network(CorrelationNet(CorrelationConfig(channels=(24, 24, 64))), tmp_path / "thin.st")
    with pytest.raises(InputError, match=r"\(24, 64\) channels at strides 4 and 8"):
        Teacher(tmp_path / "thin.st", CompactCorrelationNet())
    with pytest.raises(InputError, match="only a compact network"):
        Teacher(tmp_path / "thin.st", ActionNet())
