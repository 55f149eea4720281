"""The data module: held-out meshes, streams that never repeat, written pairs, rollouts."""

import dataclasses
import os
from collections import Counter
from collections.abc import Iterator
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pytorch_lightning as pl
import torch

from lightning_modules.bank_pairs import BankStream
from lightning_modules.pair_data_module import (
    PairDataModule,
    PairStream,
    RolloutConfig,
    WrittenStream,
    _Student,
)
from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.networks.action_net import ActionConfig, ActionNet
from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
from moveit6d.networks.weights_file import save_network
from moveit6d.synthesis.training.pairs import TrainingBatch
from moveit6d.synthesis.training.shards import ShardPlan, ShardWriter
from moveit6d.synthesis.training.source import PairSource
from tests.support.pairs import preset, small_source

TINY = CorrelationConfig(channels=(4, 6, 8), geometry=(4, 4, 4), context=8, decoder=8, fine=8)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> PairSource:
    """Three pictures and one procedural shape."""
    return small_source(tmp_path_factory.mktemp("photos"))


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
    empty = tmp_path / "empty"
    empty.mkdir()
    with pytest.raises(InputError, match=r"holds no .* file"):
        PairDataModule(occluders=empty).source()


def first_delta(source: PairSource, step: int, first: int = 0) -> torch.Tensor:
    stream = PairStream(source, 2, 50, (0, step), None, first)
    return next(iter(stream)).delta


def test_a_resumed_stream_and_another_process_draw_other_pairs(source: PairSource) -> None:
    now, again = first_delta(source, 0), first_delta(source, 0)
    assert torch.equal(now, again)
    assert not torch.equal(first_delta(source, 250), now)
    assert not torch.equal(first_delta(source, 0, first=1), now)


@pytest.mark.parametrize(("renew_every", "made"), [(0, 1), (1, 4), (2, 2)])
def test_shapes_are_renewed_unless_the_object_is_to_stay(
    source: PairSource, monkeypatch: pytest.MonkeyPatch, renew_every: int, made: int
) -> None:
    shapes = []
    original = PairSource.shape

    def counted(
        self: PairSource,
        random: np.random.Generator,
        pictures: list[np.ndarray],
        meshes: tuple[Mesh, ...],
    ) -> Mesh:
        shapes.append(original(self, random, pictures, meshes))
        return shapes[-1]

    monkeypatch.setattr(PairSource, "shape", counted)
    list(islice(PairStream(source, 1, renew_every, (0, 0)), 3))
    assert len(shapes) == made


def test_symmetric_shapes_are_as_many_as_wanted(source: PairSource) -> None:
    some = dataclasses.replace(source, symmetric=1.0)
    random = np.random.default_rng(0)
    assert all(not some.shape(random, []).symmetries.is_trivial for _ in range(4))


def test_untextured_copies_of_the_meshes_are_as_many_as_wanted(source: PairSource) -> None:
    some = dataclasses.replace(source, untextured=0.5)
    random = np.random.default_rng(0)
    mesh = some.shape(random, [])
    drawn = [some.shape(random, [], [mesh]) for _ in range(40)]
    copies = sum(shape.vertices is mesh.vertices for shape in drawn)
    assert copies == pytest.approx(20, abs=8)
    assert some.shape(random, []).vertices is not mesh.vertices, "without meshes there are none"


def test_slender_copies_are_as_many_as_wanted(source: PairSource) -> None:
    some = dataclasses.replace(source, slender=0.5)
    random = np.random.default_rng(0)
    mesh = source.shape(random, [])
    drawn = [some.shape(random, [], [mesh]) for _ in range(40)]
    slender = [shape for shape in drawn if shape.name.startswith("slender_")]
    assert len(slender) == pytest.approx(20, abs=8)
    of_mesh = sum(shape.name == f"slender_{mesh.name}" for shape in slender)
    assert 0 < of_mesh < len(slender), "others are copies of shapes"


# -- states that the network itself leads to -------------------------------------------------------


def batches(source: PairSource, rollouts: RolloutConfig, count: int) -> list[torch.Tensor]:
    stream = PairStream(source, 2, 0, (0, 0), rollouts)
    return [batch.delta for batch in islice(stream, count)]


def test_without_a_network_file_all_batches_are_fresh(source: PairSource, tmp_path: Path) -> None:
    fresh = batches(source, RolloutConfig(), 3)
    waiting = batches(source, RolloutConfig(tmp_path / "none.safetensors", 3), 3)
    assert all(torch.equal(a, b) for a, b in zip(fresh, waiting, strict=True))


def test_with_one_every_second_batch_is_where_it_led(source: PairSource, tmp_path: Path) -> None:
    weights = tmp_path / "weights.safetensors"
    save_network(CorrelationNet(TINY), weights)
    fresh = batches(source, RolloutConfig(), 1)
    found = batches(source, RolloutConfig(weights, 1), 2)
    assert torch.equal(found[0], fresh[0])
    assert found[1].shape == fresh[0].shape and not torch.equal(found[1], fresh[0])
    assert (found[1] - found[0]).abs().max() < 60, "a move away, not another pair"
    assert len(batches(source, RolloutConfig(weights, 0), 2)) == 2  # no iterations: none asked


def test_a_new_file_is_read_anew(tmp_path: Path) -> None:
    weights = tmp_path / "weights.safetensors"
    save_network(CorrelationNet(TINY), weights)
    student = _Student(RolloutConfig(weights, 1))
    assert student.ready()
    first = student.network
    assert student.ready() and student.network is first
    save_network(CorrelationNet(TINY), weights)
    os.utime(weights, (1e9, 1e9))
    assert student.ready() and student.network is not first


def test_a_network_of_single_actions_cannot_lead(source: PairSource, tmp_path: Path) -> None:
    weights = tmp_path / "weights.safetensors"
    save_network(ActionNet(ActionConfig(channels=(4, 4, 4, 4), hidden=4)), weights)
    with pytest.raises(InputError, match="all six axes"):
        batches(source, RolloutConfig(weights, 1), 2)


# -- pairs that the GPU draws ----------------------------------------------------------------------


def test_every_process_draws_other_pairs_on_its_gpu(monkeypatch: pytest.MonkeyPatch) -> None:
    def seeds(rank: int) -> list[int]:
        """What the stream of a training process draws first from its seed."""
        monkeypatch.setattr(PairDataModule, "_rank", lambda _: rank)
        stream = PairDataModule(shapes=1, device="cuda", seed=3).train_dataloader().dataset
        assert isinstance(stream, BankStream)
        drawn: list[int] = []

        def batches(_: object, pool: object, random: np.random.Generator) -> Iterator[None]:
            drawn.extend(random.integers(2**62, size=4).tolist())
            yield

        monkeypatch.setattr(BankStream, "_batches", batches)
        next(iter(stream))
        return drawn

    first, second = seeds(0), seeds(1)
    assert not set(first) & set(second)
    one_process = np.random.default_rng([3, 0])  # as before there were several
    assert first == one_process.integers(2**62, size=4).tolist()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"written": Path("pairs")}, r"data\.written is set"),
        ({"written": Path("pairs"), "dihedral": True}, r"data\.written is set"),
        ({"occluders": Path()}, r"data\.occluders is set"),
        ({"rollouts": RolloutConfig(Path("w"), 2)}, r"data\.rollouts\.weights is set"),
        ({"renew_every": 0}, r"data\.renew_every is 0.* set data\.renew_every to 50"),
    ],
)
def test_what_has_no_effect_on_the_gpu_is_refused(
    tmp_path: Path, options: dict[str, Any], words: str
) -> None:
    if "occluders" in options:
        options = {"occluders": folder_of(tmp_path, 1)}
    with pytest.raises(InputError, match=words):
        PairDataModule(device="cuda", **options).train_dataloader()


def test_meshes_alone_need_no_renewing_on_the_gpu(tmp_path: Path) -> None:
    module = PairDataModule(
        meshes=folder_of(tmp_path, 1), holdout=0, shapes=0, renew_every=0, device="cuda"
    )
    assert isinstance(module.train_dataloader().dataset, BankStream)


# -- pairs from disk -------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def written(source: PairSource, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("pairs")
    writer = ShardWriter(source, ShardPlan(4, batches=2, batch_size=2), folder)
    writer.claim()
    for number in range(4):
        writer.write(number)
    return folder


def test_the_loader_reads_every_written_pair_once_in_workers(written: Path) -> None:
    def epoch(workers: int) -> Counter[tuple[float, ...]]:
        module = PairDataModule(written=written, batch_size=2, workers=workers)
        loader = module.train_dataloader()
        return Counter(tuple(b.delta.flatten().tolist()) for b in islice(loader, 8))

    alone = epoch(0)
    assert len(alone) == 8 and set(alone.values()) == {1}
    assert epoch(2) == alone


def test_processes_share_written_pairs_and_go_on(written: Path) -> None:
    def delta(step: int, rank: int, number: int) -> list[tuple[float, ...]]:
        stream = WrittenStream(written, 2, 0, step, rank, 2)
        return [tuple(b.delta.flatten().tolist()) for b in islice(stream, number)]

    first, second = delta(0, 0, 4), delta(0, 1, 4)
    assert not set(first) & set(second) and len(set(first + second)) == 8
    assert delta(3, 1, 1) == second[3:]


def test_written_pairs_come_in_other_dihedral_views_each_time(written: Path) -> None:
    module = PairDataModule(written=written, dihedral=True, batch_size=2, workers=0)
    batches = list(islice(module.train_dataloader(), 64))  # eight epochs

    def sides(batch: TrainingBatch) -> tuple[float, ...]:
        lengths = batch.delta.reshape(-1, 2, 3)
        return tuple(lengths.norm(dim=2).flatten().tolist())  # the same in all views

    kinds = Counter(tuple(round(value, 3) for value in sides(batch)) for batch in batches)
    assert set(kinds.values()) == {8}
    assert len({tuple(batch.delta.flatten().tolist()) for batch in batches}) > 24


def test_dihedral_views_are_of_written_pairs() -> None:
    with pytest.raises(InputError, match=r"data\.dihedral is for written pairs"):
        PairDataModule(dihedral=True)


def test_rollouts_are_of_what_the_fit_itself_exports_unless_told_otherwise(tmp_path: Path) -> None:
    for given, used in ((None, tmp_path / "weights.safetensors"), (Path("other"), Path("other"))):
        module = PairDataModule(shapes=1, workers=0, rollouts=RolloutConfig(given, 2))
        module.trainer = pl.Trainer(
            default_root_dir=tmp_path, accelerator="cpu", logger=False, enable_checkpointing=False
        )
        stream = module.train_dataloader().dataset
        assert isinstance(stream, PairStream)
        assert stream.rollouts == RolloutConfig(used, 2)


def test_templates_are_not_among_written_pairs(written: Path) -> None:
    module = PairDataModule(written=written, pairs=preset("linear_light"))
    with pytest.raises(InputError, match=r"data\.pairs\.views\.share is 0\.4"):
        module.train_dataloader()


def test_written_pairs_and_rollouts_exclude_each_other(written: Path) -> None:
    module = PairDataModule(written=written, rollouts=RolloutConfig(Path("w"), 2))
    with pytest.raises(InputError, match=r"data\.rollouts\.iterations"):
        module.train_dataloader()
