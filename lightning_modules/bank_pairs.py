"""Pairs drawn on a GPU: objects in its memory, made and loaded by worker processes.

Never trains.
"""

from __future__ import annotations

import multiprocessing
import os
from collections import deque
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
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
from moveit6d.synthesis.augmentation.photos import load_photos
from moveit6d.synthesis.objects.object_set import BankObjects, ObjectSet
from moveit6d.synthesis.training.pairs import PairGenerator, TrainingBatch
from moveit6d.synthesis.training.source import PairSource

TEXTURES = 150  # photographs that a worker process keeps for made objects
HANDS = 96  # hands and cards, made once
CARDS = 0.35  # share of them that are cards
RENEWED = 4  # made objects replaced a batch at most


class BankStream(IterableDataset[TrainingBatch]):
    """Batches without end, all on one device; each picture in 1 + `iterations` states.

    After a batch of new pictures come as many of the same ones, each after one more iteration of
    the `student`: it answers an observation with a pose delta (B, 6), or None if it is too young.
    """

    def __init__(
        self, source: PairSource, batch_size: int, seed: tuple[int, int], device: torch.device,
        iterations: int = 0, student: Callable[[Observation], Tensor | None] | None = None,
        run: Run | None = None,
    ) -> None:  # fmt: skip
        super().__init__()
        self.source, self.batch_size, self.seed, self.device = source, batch_size, seed, device
        self.iterations, self.student, self.run = iterations, student, run

    def __iter__(self) -> Iterator[TrainingBatch]:
        random = np.random.default_rng([*self.seed])
        processes = min(16, max(1, (os.cpu_count() or 1)))
        context = multiprocessing.get_context("spawn")
        setup = (self.source.photos, self.source.symmetric)
        with ProcessPoolExecutor(processes, context, _begin, setup) as pool:
            yield from self._batches(pool, random)

    def _batches(
        self, pool: ProcessPoolExecutor, random: np.random.Generator
    ) -> Iterator[TrainingBatch]:
        source = self.source
        seeds = iter(lambda: int(random.integers(2**62)), None)
        files = list(pool.map(_file, source.meshes, [source.mesh_unit] * len(source.meshes)))
        made = [self._made(pool, next(seeds)) for _ in range(source.shapes)]
        hands = list(pool.map(_hand, [next(seeds) for _ in range(HANDS)]))
        shapes = [future.result() for future in made]
        packed = [*files, *shapes, *(mesh for mesh, _, _ in hands)]
        bank = MeshBank.of(packed, self.device)
        renderer = BankRenderer(bank, self.run)
        ends = [len(files), len(files) + len(shapes), len(packed)]
        slots = [range(start, end) for start, end in zip([0, *ends], ends, strict=False)]
        # As with few procedural shapes that are renewed often: their share of the pairs matters.
        weights = [float(len(files)), source.shape_share * max(1, len(files))]
        objects = BankObjects(
            renderer, slots[:2] if files else slots[1:2], weights if files else [1.0]
        )
        kept = BankHands(BankObjects(renderer, [slots[2]], [1.0]), hands, slots[2][0])
        photos = PhotoBank(source.load_photos(random), self.device)
        generator = PairGenerator(
            objects, photos, source.pairs, int(random.integers(2**62)), hands=kept
        )
        waiting: deque[Future[PackedMesh]] = deque()
        for _ in count():
            batch = generator.batch(self.batch_size)
            yield batch
            for _ in range(self.iterations):
                delta = None if self.student is None else self.student(batch.observation)
                if delta is None:
                    break
                batch = generator.advance(batch, delta)
                yield batch
            while len(waiting) < 4 * RENEWED and len(shapes):
                waiting.append(self._made(pool, next(seeds)))
            for _ in range(RENEWED):
                if not waiting or not waiting[0].done():
                    break
                new = waiting.popleft().result()
                if bank.fits(new):
                    bank.put(slots[1][int(random.integers(len(shapes)))], new)

    def _made(self, pool: ProcessPoolExecutor, seed: int) -> Future[PackedMesh]:
        """A new shape, or a copy of one of the meshes without its print."""
        random, source = np.random.default_rng(seed), self.source
        if source.meshes and random.random() < source.untextured * (1 - source.symmetric):
            path = source.meshes[int(random.integers(len(source.meshes)))]
            return pool.submit(_untextured, path, source.mesh_unit, seed)
        return pool.submit(_shape, seed)


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


# Of each worker process: photographs for textures, and the share of symmetric shapes.
_PHOTOS: list[np.ndarray] = []
_SYMMETRIC = 0.0


def _begin(photos: Path | None, symmetric: float) -> None:
    global _SYMMETRIC
    torch.set_num_threads(1)
    if photos is not None:
        _PHOTOS.extend(load_photos(Path(photos), TEXTURES))
    _SYMMETRIC = symmetric


def _file(path: Path, unit: str) -> PackedMesh:
    return pack_mesh(Mesh.load(path, unit=unit))  # type: ignore[arg-type]


def _untextured(path: Path, unit: str, seed: int) -> PackedMesh:
    from moveit6d.synthesis.objects.untextured import untextured_copy

    return pack_mesh(untextured_copy(np.random.default_rng(seed), Mesh.load(path, unit=unit)))  # type: ignore[arg-type]


def _shape(seed: int) -> PackedMesh:
    from moveit6d.synthesis.objects.shapes import random_object
    from moveit6d.synthesis.objects.symmetric_shapes import symmetric_object

    random = np.random.default_rng(seed)
    kind = symmetric_object if random.random() < _SYMMETRIC else random_object
    return pack_mesh(kind(random, _PHOTOS))


def _hand(seed: int) -> tuple[PackedMesh, np.ndarray, bool]:
    random = np.random.default_rng(seed)
    made = procedural_hand(random, CARDS, _PHOTOS)
    return pack_mesh(made.mesh), np.asarray(made.tip), made.along is not None
