"""The data module: which meshes are held out, and streams that never repeat."""

from itertools import islice
from pathlib import Path

import pytest
import torch

from lightning_modules.pair_data_module import PairDataModule, PairSource, PairStream
from moveit6d.errors import InputError
from moveit6d.synthesis.pairs import PairConfig


def folder_of(tmp_path: Path, count: int) -> Path:
    for k in range(count):
        (tmp_path / f"{k:03d}.glb").touch()
    (tmp_path / "notes.txt").touch()
    return tmp_path


def test_held_out_meshes_are_spread_and_never_trained_on(tmp_path: Path) -> None:
    train, held = PairDataModule(meshes=folder_of(tmp_path, 40), holdout=8).mesh_paths()
    assert len(train) == 32 and len(held) == 8
    assert not set(train) & set(held)
    numbers = [int(path.stem) for path in held]
    assert min(numbers) < 5 and max(numbers) > 35


def test_one_object_alone_needs_no_holdout(tmp_path: Path) -> None:
    train, held = PairDataModule(meshes=folder_of(tmp_path, 1), holdout=0).mesh_paths()
    assert len(train) == 1 and held == []


def test_a_folder_with_too_few_meshes_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds 3"):
        PairDataModule(meshes=folder_of(tmp_path, 3)).mesh_paths()


def test_a_resumed_stream_draws_other_pairs() -> None:
    source = PairSource((), "m", None, None, 2, PairConfig())
    batches = [
        next(islice(PairStream(source, 2, 50, (0, step)), 0, 1)).counts for step in (0, 250, 0)
    ]
    assert torch.equal(batches[0], batches[2])
    assert not torch.equal(batches[0], batches[1])
