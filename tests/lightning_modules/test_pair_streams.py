"""Streams of batches: never the same twice, renewed or lasting shapes, rollouts, written pairs."""

import os
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from lightning_modules.pair_streams import PairStream, RolloutConfig, WrittenStream, _Student
from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.networks.action_net import ActionConfig, ActionNet
from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
from moveit6d.networks.weights_file import save_network
from moveit6d.synthesis.training.source import PairSource

TINY = CorrelationConfig(channels=(4, 6, 8), geometry=(4, 4, 4), context=8, decoder=8, fine=8)


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


# -- states that the network itself leads to -------------------------------------------------------


def batches(
    source: PairSource, rollouts: RolloutConfig, count: int, step: int = 0, accumulated: int = 1
) -> list[torch.Tensor]:
    stream = PairStream(source, 2, 0, (0, step), rollouts, 0, accumulated)
    return [batch.delta for batch in islice(stream, count)]


def test_without_a_network_file_all_batches_are_fresh(source: PairSource, tmp_path: Path) -> None:
    fresh = batches(source, RolloutConfig(), 3)
    waiting = batches(source, RolloutConfig(tmp_path / "none.safetensors", 3, 0), 3)
    assert all(torch.equal(a, b) for a, b in zip(fresh, waiting, strict=True))


def test_with_one_every_second_batch_is_where_it_led(source: PairSource, tmp_path: Path) -> None:
    weights = tmp_path / "weights.safetensors"
    save_network(CorrelationNet(TINY), weights)
    fresh = batches(source, RolloutConfig(), 1)
    found = batches(source, RolloutConfig(weights, 1, 0), 2)
    assert torch.equal(found[0], fresh[0])
    assert found[1].shape == fresh[0].shape and not torch.equal(found[1], fresh[0])
    assert (found[1] - found[0]).abs().max() < 60, "a move away, not another pair"
    assert len(batches(source, RolloutConfig(weights, 0, 0), 2)) == 2  # no iterations: none asked


@pytest.mark.parametrize(
    ("first_step", "step", "accumulated", "fresh"),
    [(0, 0, 1, 1), (2, 0, 1, 2), (2, 0, 2, 4), (1000, 0, 1, 6), (1000, 998, 1, 2)],
)
def test_rollouts_begin_at_their_step(
    source: PairSource, tmp_path: Path, first_step: int, step: int, accumulated: int, fresh: int
) -> None:
    weights = tmp_path / "weights.safetensors"
    save_network(CorrelationNet(TINY), weights)
    new = batches(source, RolloutConfig(), 6, step)
    found = batches(source, RolloutConfig(weights, 1, first_step), 6, step, accumulated)
    led = [number for number in range(6) if not torch.equal(new[number], found[number])]
    assert min(led, default=6) == fresh


def test_every_worker_knows_the_step(source: PairSource, tmp_path: Path) -> None:
    weights = tmp_path / "weights.safetensors"
    save_network(CorrelationNet(TINY), weights)

    def loaded(rollouts: RolloutConfig) -> list[torch.Tensor]:
        stream = PairStream(source, 2, 0, (0, 0), rollouts)
        loader = DataLoader(stream, batch_size=None, num_workers=2)
        return [batch.delta for batch in islice(loader, 6)]

    pairs = zip(loaded(RolloutConfig()), loaded(RolloutConfig(weights, 1, 3)), strict=True)
    same = [torch.equal(one, other) for one, other in pairs]
    assert same == [True, True, True, False, False, False]


def test_a_new_file_is_read_anew(tmp_path: Path) -> None:
    weights = tmp_path / "weights.safetensors"
    save_network(CorrelationNet(TINY), weights)
    student = _Student(RolloutConfig(weights, 1, 0))
    assert student.ready(0)
    first = student.network
    assert student.ready(0) and student.network is first
    save_network(CorrelationNet(TINY), weights)
    os.utime(weights, (1e9, 1e9))
    assert student.ready(0) and student.network is not first


def test_a_network_of_single_actions_cannot_lead(source: PairSource, tmp_path: Path) -> None:
    weights = tmp_path / "weights.safetensors"
    save_network(ActionNet(ActionConfig(channels=(4, 4, 4, 4), hidden=4)), weights)
    with pytest.raises(InputError, match="all six axes"):
        batches(source, RolloutConfig(weights, 1, 0), 2)


# -- pairs from disk -------------------------------------------------------------------------------


def test_processes_share_written_pairs_and_go_on(written: Path) -> None:
    def delta(used: int, rank: int, number: int) -> list[tuple[float, ...]]:
        stream = WrittenStream(written, 2, 0, used, rank, 2)
        return [tuple(b.delta.flatten().tolist()) for b in islice(stream, number)]

    first, second = delta(0, 0, 4), delta(0, 1, 4)
    assert not set(first) & set(second) and len(set(first + second)) == 8
    assert delta(3, 1, 1) == second[3:]
