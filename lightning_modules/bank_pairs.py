"""Pairs drawn on a GPU: objects in its memory, made and loaded by worker processes.

Never trains.
"""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from itertools import count
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import IterableDataset

from moveit6d.geometry.mesh import Mesh
from moveit6d.observation import Observation
from moveit6d.rendering.cuda_renderer import BankRenderer, Run
from moveit6d.rendering.mesh_bank import MeshBank, PackedMesh, pack_mesh
from moveit6d.synthesis.augmentation.hands import procedural_hand
from moveit6d.synthesis.augmentation.photo_bank import PhotoBank
from moveit6d.synthesis.objects.object_set import BankObjects, ObjectSet
from moveit6d.synthesis.training.pairs import PairGenerator, TrainingBatch
from moveit6d.synthesis.training.source import PairSource

TEXTURES = 150  # photographs that a worker process keeps for procedural objects
HANDS = 96  # hands and cards, made once
DRAWN = 4  # batches drawn together: small operations cost a GPU about as much as large ones
RENEWED = 16  # procedural objects replaced at most after so many batches


class BankStream(IterableDataset[TrainingBatch]):
    """Batches without end, all on one device; each picture in 1 + `iterations` states.

    After `DRAWN` batches of new pictures come as many of the same ones, each after one more
    iteration of the `student`: it answers an observation with a pose delta (B, 6), or None if it is
    too young. `seed` is that of the fit, the training step and the rank of the process.
    """

    def __init__(
        self, source: PairSource, batch_size: int, seed: tuple[int, int, int], device: torch.device,
        iterations: int = 0, student: Callable[[Observation], Tensor | None] | None = None,
        run: Run | None = None,
    ) -> None:  # fmt: skip
        super().__init__()
        self.source, self.batch_size, self.seed, self.device = source, batch_size, seed, device
        self.iterations, self.student, self.run = iterations, student, run

    def __iter__(self) -> Iterator[TrainingBatch]:
        random = np.random.default_rng([*self.seed])
        processes = min(16, max(1, (os.cpu_count() or 1) - 2))  # this one needs a core for itself
        context = multiprocessing.get_context("spawn")
        with ProcessPoolExecutor(processes, context, _begin, (self.source,)) as pool:
            yield from self._batches(pool, random)

    def _batches(
        self, pool: ProcessPoolExecutor, random: np.random.Generator
    ) -> Iterator[TrainingBatch]:
        source = self.source
        seeds = iter(lambda: int(random.integers(2**62)), None)
        files = list(pool.map(_file, source.meshes))
        made = [pool.submit(_shape, next(seeds)) for _ in range(source.shapes)]
        hands = list(pool.map(_hand, [next(seeds) for _ in range(HANDS)]))
        shapes = [future.result() for future in made]
        packed = [*files, *shapes, *(mesh for mesh, _, _ in hands)]
        bank = MeshBank.of(packed, self.device)
        renderer = BankRenderer(bank, self.run)
        ends = [len(files), len(files) + len(shapes), len(packed)]
        slots = [range(start, end) for start, end in zip([0, *ends], ends, strict=False)]
        groups = [some for some in slots[:2] if some]  # of meshes as many pairs as of shapes
        objects = BankObjects(renderer, groups, [1.0] * len(groups))
        kept = BankHands(BankObjects(renderer, [slots[2]], [1.0]), hands, slots[2][0])
        photos = PhotoBank(source.load_photos(random), self.device)
        generator = PairGenerator(
            objects, photos, source.pairs, int(random.integers(2**62)), hands=kept
        )
        waiting: deque[Future[PackedMesh]] = deque()
        for _ in count():
            drawn = generator.batch(DRAWN * self.batch_size)
            yield from drawn.parts(DRAWN)
            for _ in range(self.iterations):
                delta = None if self.student is None else self.student(drawn.observation)
                if delta is None:
                    break
                drawn = generator.advance(drawn, delta)
                yield from drawn.parts(DRAWN)
            while len(waiting) < 4 * RENEWED and len(shapes):
                waiting.append(pool.submit(_shape, next(seeds)))
            for _ in range(RENEWED):
                if not waiting or not waiting[0].done():
                    break
                new = waiting.popleft().result()
                bank.put(slots[1][int(random.integers(len(shapes)))], new)


class BankHands:
    """Hands and cards that lie in a bank."""

    def __init__(
        self, objects: BankObjects, hands: list[tuple[PackedMesh, np.ndarray, bool]], first: int
    ) -> None:
        self.objects, self.first = objects, first
        self.tips = torch.from_numpy(np.stack([tip for _, tip, _ in hands]))
        self.reaching = torch.tensor([reaches for _, _, reaches in hands])
        self.random = np.random.default_rng(0)

    def take(self, count: int) -> tuple[ObjectSet, Tensor, Tensor, Tensor]:
        """See `HandSource`."""
        index = self.objects.draw(self.random, count)
        place = index - self.first
        return self.objects, index, self.tips[place], self.reaching[place]


class MeshFiles(Sequence[Mesh]):
    """The meshes of a source, each read when it is asked for: no worker keeps them all."""

    def __init__(self, source: PairSource) -> None:
        self.source = source

    def __len__(self) -> int:
        return len(self.source.meshes)

    def __getitem__(self, number: int) -> Mesh:  # type: ignore[override]
        return self.source.load(self.source.meshes[number])


class Worker:
    """Makes and loads the objects of a source in a process of its own."""

    def __init__(self, source: PairSource) -> None:
        self.source, self.meshes = source, MeshFiles(source)
        # The same in every worker: what a seed makes does not depend on who makes it.
        few = replace(source, photo_limit=TEXTURES)
        self.photos = few.load_photos(np.random.default_rng(0))

    def file(self, path: Path) -> PackedMesh:
        """One of the mesh files."""
        return pack_mesh(self.source.load(path))

    def shape(self, seed: int) -> PackedMesh:
        """A new procedural shape, or a copy of one of the meshes without its texture."""
        random = np.random.default_rng(seed)
        return pack_mesh(self.source.shape(random, self.photos, self.meshes))

    def hand(self, seed: int) -> tuple[PackedMesh, np.ndarray, bool]:
        """A new hand or card, its tip, and whether it is a hand."""
        cards = self.source.pairs.hands.card_probability
        hand = procedural_hand(np.random.default_rng(seed), cards, self.photos)
        return pack_mesh(hand.mesh), np.asarray(hand.tip), hand.along is not None


_SOURCES: list[PairSource] = []  # of each worker process its own


def _begin(source: PairSource) -> None:
    torch.set_num_threads(1)
    _SOURCES.append(source)


@cache  # made by the first task: its error is told, one in `_begin` would break the pool
def _worker() -> Worker:
    return Worker(_SOURCES[-1])


def _file(path: Path) -> PackedMesh:
    return _worker().file(path)


def _shape(seed: int) -> PackedMesh:
    return _worker().shape(seed)


def _hand(seed: int) -> tuple[PackedMesh, np.ndarray, bool]:
    return _worker().hand(seed)
