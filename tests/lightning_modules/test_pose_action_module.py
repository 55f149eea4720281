"""The module: what it starts from."""

from pathlib import Path

import torch

from lightning_modules.pose_action_module import PoseActionModule
from moveit6d.networks.correlation import CorrelationNet
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
