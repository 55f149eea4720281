"""Pairs on disk: the same whoever writes them, whole or not there, read once an epoch."""

import multiprocessing
import os
import signal
import time
from collections import Counter
from dataclasses import replace
from itertools import chain, islice
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.synthesis.training.pairs import TrainingBatch
from moveit6d.synthesis.training.shards import (
    ShardPlan,
    ShardWriter,
    open_shards,
    read_shard,
    shard_path,
    shard_stream,
    write_shard,
    written_crop,
    written_digest,
)
from moveit6d.synthesis.training.source import PairSource
from tests.support.pairs import small_source, write_every_shard

PLAN = ShardPlan(shards=5, batches=2, batch_size=2, seed=3)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> PairSource:
    """Three pictures and one procedural shape a shard."""
    return small_source(tmp_path_factory.mktemp("photos"))


@pytest.fixture(scope="module")
def whole(source: PairSource, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All shards, written by one writer."""
    return write_every_shard(source, PLAN, tmp_path_factory.mktemp("pairs"))


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def test_parts_are_disjoint_and_leave_nothing_out() -> None:
    parts = [ShardPlan(11).part(number, 3) for number in (1, 2, 3)]
    assert Counter(chain(*parts)) == Counter(range(11))
    with pytest.raises(InputError, match="part 4 of 3"):
        PLAN.part(4, 3)


def test_templates_are_not_lost_in_silence(source: PairSource, tmp_path: Path) -> None:
    views = replace(source.pairs.views, share=0.4)
    some = replace(source, pairs=replace(source.pairs, views=views))
    with pytest.raises(
        InputError, match=r"views\.share is 0\.4.*set data\.pairs\.views\.share to 0"
    ):
        ShardWriter(some, PLAN, tmp_path)


def test_what_is_read_is_what_was_drawn(source: PairSource, whole: Path) -> None:
    random = np.random.default_rng([PLAN.seed, 2])
    pictures = source.load_photos(random)
    drawn = source.generator(random, pictures, [source.shape(random, pictures)]).batch(2)
    read = next(read_shard(shard_path(whole, 2, PLAN), 2))
    assert torch.equal(read.observation.image, drawn.observation.image)
    assert torch.allclose(read.observation.rendering, drawn.observation.rendering, atol=0.51 / 255)
    for name in ("delta", "visible", "true_mask", "clear", "mesh", "zoom", "rotation"):
        assert torch.equal(getattr(read, name), getattr(drawn, name)), name
    assert torch.allclose(read.true_depth, drawn.true_depth, atol=3e-4)
    assert torch.allclose(read.observation.depth, drawn.observation.depth, atol=3e-4)
    assert torch.equal(read.observation.mask, drawn.observation.mask)
    assert torch.equal(read.observation.distance, drawn.observation.distance)


def test_a_folder_says_which_crops_its_pairs_show_and_what_they_were_drawn_from(
    source: PairSource, whole: Path, tmp_path: Path
) -> None:
    assert written_crop(whole) == "look_at"
    some = replace(source, pairs=replace(source.pairs, crop="axis_parallel"))
    plan = ShardPlan(1, batches=1, batch_size=2)
    writer = ShardWriter(some, plan, tmp_path)
    writer.claim()
    with pytest.raises(InputError, match="lacks 1 of its 1 shards"):
        written_crop(tmp_path)
    writer.write(0)
    assert written_crop(tmp_path) == "axis_parallel"
    assert written_digest(tmp_path) != written_digest(whole) == written_digest(whole)


@pytest.mark.parametrize(("lasting", "kinds"), [(None, 2), (3, 1)])
def test_lasting_shapes_are_in_every_shard(
    source: PairSource,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    lasting: int | None,
    kinds: int,
) -> None:
    found: set[bytes] = set()
    original = PairSource.generator

    def noted(self: PairSource, random: Any, photos: Any, meshes: Any, others: Any = None) -> Any:
        found.add(meshes[0].vertices.tobytes())
        return original(self, random, photos, meshes, others)

    monkeypatch.setattr(PairSource, "generator", noted)
    writer = ShardWriter(replace(source, lasting=lasting), ShardPlan(2, 1, 2), tmp_path)
    for number in range(2):
        writer.write(number)
    assert len(found) == kinds


def write_all(source: PairSource, folder: Path) -> None:
    """What a process does that will be killed."""
    writer = ShardWriter(source, PLAN, folder)
    writer.claim()
    for number in writer.missing(PLAN.part(1, 1)):
        writer.write(number)


def test_killed_and_started_again_in_parts_they_are_the_same(
    source: PairSource, whole: Path, tmp_path: Path
) -> None:
    folder = tmp_path / "pairs"
    context = multiprocessing.get_context("fork")
    process = context.Process(target=write_all, args=(source, folder))
    process.start()
    first = shard_path(folder, 0, PLAN)
    deadline = time.monotonic() + 300
    while not first.exists() and process.is_alive() and time.monotonic() < deadline:
        time.sleep(0.005)
    assert process.pid is not None
    os.kill(process.pid, signal.SIGKILL)
    process.join()
    writer = ShardWriter(source, PLAN, folder)
    left = writer.missing(PLAN.part(1, 1))
    assert first.exists() and left, "killed too late to show anything"
    with pytest.raises(InputError, match=f"lacks {len(left)} of its 5 shards"):
        open_shards(folder)
    kept = first.stat().st_mtime_ns
    for part in (2, 1):  # as two machines would
        writer.claim()
        for number in writer.missing(PLAN.part(part, 2)):
            write_shard((source, PLAN, folder, number))
    for leftover in folder.glob(".*"):  # of the killed process
        leftover.unlink()
    assert first.stat().st_mtime_ns == kept
    assert contents(folder) == contents(whole)


def key(batch: TrainingBatch) -> tuple[float, ...]:
    return tuple(batch.delta.flatten().tolist())


def test_an_epoch_is_every_pair_once_whoever_reads(whole: Path) -> None:
    everything = Counter(
        key(b) for n in range(5) for b in read_shard(shard_path(whole, n, PLAN), 2)
    )
    assert len(everything) == 10 and set(everything.values()) == {1}
    alone = Counter(key(batch) for batch in islice(shard_stream(whole, 2, 0), 10))
    assert alone == everything
    shared = Counter[tuple[float, ...]]()
    for reader, share in ((0, 6), (1, 4)):  # three and two of the five shards
        shared.update(key(b) for b in islice(shard_stream(whole, 2, 0, reader, 2), share))
    assert shared == everything


def test_reading_goes_on_where_it_was(whole: Path) -> None:
    through = [key(batch) for batch in islice(shard_stream(whole, 2, 7), 14)]
    for start in (1, 4, 11):
        rest = [key(b) for b in islice(shard_stream(whole, 2, 7, skip=start), 14 - start)]
        assert rest == through[start:]
    assert through[:10] != [key(batch) for batch in islice(shard_stream(whole, 2, 8), 10)]


def test_foreign_folders_and_damage_are_refused(
    source: PairSource, whole: Path, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="pairs of another seed"):
        ShardWriter(source, replace(PLAN, seed=4), whole).claim()
    with pytest.raises(InputError, match="pairs of another source"):
        ShardWriter(replace(source, shapes=2), PLAN, whole).claim()
    with pytest.raises(InputError, match=r"has no pairs\.json"):
        open_shards(tmp_path)
    with pytest.raises(InputError, match="too few for 6 readers"):
        next(shard_stream(whole, 2, 0, 0, 6))
    bad = tmp_path / "bad.safetensors"
    bad.write_bytes(shard_path(whole, 0, PLAN).read_bytes()[:5000])
    with pytest.raises(InputError, match="damaged"):
        next(read_shard(bad, 2))
