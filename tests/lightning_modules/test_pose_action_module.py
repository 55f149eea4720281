"""The module: what it starts from."""

from pathlib import Path

import pytest
import pytorch_lightning as pl
import torch

from lightning_modules.pair_data_module import PairDataModule
from lightning_modules.pose_action_module import PoseActionModule
from moveit6d.errors import InputError
from moveit6d.networks.action_net import ActionConfig, ActionNet
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
