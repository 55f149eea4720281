"""Pairs drawn from a bank, in miniature on the CPU: new pictures, and the states after them."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from torch import Tensor

from lightning_modules.bank_pairs import BankStream, Worker
from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.observation import Observation
from moveit6d.synthesis.training.source import PROCEDURAL_PHOTOS, PairSource
from tests.support.pairs import preset
from tests.support.rasterizer import compiled


@pytest.mark.filterwarnings("ignore")
def test_new_pictures_and_the_states_that_follow_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("lightning_modules.bank_pairs.HANDS", 2)
    monkeypatch.setattr("lightning_modules.bank_pairs.DRAWN", 2)
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    source = PairSource((), "m", None, 4, 3, preset("linear_light"), symmetric=0.5)

    def student(observation: Observation) -> Tensor:
        return torch.full((len(observation), 6), 0.5)

    stream = iter(BankStream(source, 6, (0, 0, 0), torch.device("cpu"), 1, student, compiled()))
    new, other, after, _, again = (next(stream) for _ in range(5))
    assert new.views is not None and after.views is None and again.views is not None
    assert torch.equal(new.mesh, after.mesh) and not torch.equal(new.delta, other.delta)
    assert new.observation.image.shape == (6, 3, 128, 128)
    moved = (new.delta - after.delta)[new.near > 0.5]
    assert moved.abs().max() < 8 and not torch.equal(new.delta, after.delta)


def test_a_mesh_of_one_flat_colour_is_taken_as_where_no_gpu_draws(tmp_path: Path) -> None:
    """Its material names a colour: as a user's mistake it would be refused, here it is meant."""
    box = trimesh.creation.box((0.05, 0.06, 0.07))
    box.visual.face_colors = (90, 120, 30, 255)
    path = tmp_path / "box.ply"
    box.export(path)
    source = PairSource((path,), "m", None, None, 2, preset("linear_light"), untextured=1.0)
    with pytest.raises(InputError):
        Mesh.load(path)
    worker = Worker(source)
    assert len(worker.file(path).corners) == 12
    assert len(worker.shape(0).corners) == 12, "a copy of it without its texture"
    again = Worker(source).hand(3)[0]
    assert np.array_equal(worker.hand(3)[0].texels, again.texels)
    assert len(worker.photos) == PROCEDURAL_PHOTOS, "for want of a folder"
    assert Worker(replace(source, symmetric=1.0)).shape(0).symmetries.shape[0] > 1
