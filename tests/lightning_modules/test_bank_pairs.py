"""Pairs drawn from a bank, in miniature on the CPU: new pictures, and the states after them."""

import pytest
import torch
from torch import Tensor

from lightning_modules.bank_pairs import BankStream
from moveit6d.observation import Observation
from moveit6d.synthesis.training.source import PairSource
from tests.support.pairs import preset
from tests.support.rasterizer import compiled


@pytest.mark.filterwarnings("ignore")
def test_new_pictures_and_the_states_that_follow_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lightning_modules.bank_pairs.HANDS", 2)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    source = PairSource((), "m", None, 4, 3, preset("linear_light"), symmetric=0.5)

    def student(observation: Observation) -> Tensor:
        return torch.full((len(observation), 6), 0.5)

    stream = iter(BankStream(source, 6, (0, 0), torch.device("cpu"), 1, student, compiled()))
    new, after, again = next(stream), next(stream), next(stream)
    assert new.views is not None and after.views is None and again.views is not None
    assert torch.equal(new.mesh, after.mesh)
    assert new.observation.image.shape == (6, 3, 128, 128)
    moved = (new.delta - after.delta)[new.near > 0.5]
    assert moved.abs().max() < 8 and not torch.equal(new.delta, after.delta)
