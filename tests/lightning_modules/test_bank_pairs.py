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


@pytest.fixture
def few(monkeypatch: pytest.MonkeyPatch) -> None:
    """Two batches at a time, two hands, one worker process."""
    monkeypatch.setattr("lightning_modules.bank_pairs.HANDS", 2)
    monkeypatch.setattr("lightning_modules.bank_pairs.DRAWN", 2)
    monkeypatch.setattr("os.cpu_count", lambda: 1)


@pytest.mark.usefixtures("few")
@pytest.mark.filterwarnings("ignore")
def test_new_pictures_and_the_states_that_follow_them() -> None:
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


def a_flat_box(folder: Path) -> Path:
    """A file of a box in one colour."""
    box = trimesh.creation.box((0.05, 0.06, 0.07))
    box.visual.face_colors = (90, 120, 30, 255)
    box.export(folder / "box.ply")
    return folder / "box.ply"


@pytest.mark.usefixtures("few")
@pytest.mark.filterwarnings("ignore")
def test_meshes_without_shapes_are_drawn(tmp_path: Path) -> None:
    source = PairSource((a_flat_box(tmp_path),), "m", None, 4, 0, preset("linear_light"))
    stream = BankStream(source, 2, (0, 0, 0), torch.device("cpu"), run=compiled())
    assert [next(iter(stream)).mesh.tolist()] == [[0, 0]]


@pytest.mark.usefixtures("few")
@pytest.mark.filterwarnings("ignore")
def test_a_folder_without_photographs_is_an_error_that_says_so(tmp_path: Path) -> None:
    source = PairSource((), "m", tmp_path / "none", None, 1, preset("linear_light"))
    stream = BankStream(source, 2, (0, 0, 0), torch.device("cpu"), run=compiled())
    with pytest.raises(InputError, match=r"Photo folder .*none does not exist"):
        next(iter(stream))


@pytest.mark.parametrize(("probability", "reaches"), [(0.0, True), (1.0, False)])
def test_cards_are_as_often_as_the_configuration_says(probability: float, reaches: bool) -> None:
    pairs = preset("linear_light")
    pairs = replace(pairs, hands=replace(pairs.hands, card_probability=probability))
    worker = Worker(PairSource((), "m", None, None, 1, pairs))
    assert {worker.hand(seed)[2] for seed in range(4)} == {reaches}


def test_a_mesh_of_one_flat_colour_is_taken_as_where_no_gpu_draws(tmp_path: Path) -> None:
    """Its material names a colour: as a user's mistake it would be refused, here it is meant."""
    path = a_flat_box(tmp_path)
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
