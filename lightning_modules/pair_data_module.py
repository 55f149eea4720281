"""Training pairs as a Lightning data module: drawn on the fly in worker processes, without end.

Never trains. Without folders it draws objects and photos that the project's own code makes, so
that a fit runs on a fresh machine.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np
import pytorch_lightning as pl
import torch
from torch.utils.data import DataLoader, Dataset, IterableDataset, get_worker_info

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.synthesis.backgrounds import procedural_photo
from moveit6d.synthesis.pairs import PairConfig, PairGenerator, TrainingBatch
from moveit6d.synthesis.photos import load_photos
from moveit6d.synthesis.shapes import random_object

MESH_SUFFIXES = {".glb", ".obj", ".ply", ".stl"}
MADE_PHOTOS = 64  # pictures that are made where there is no folder of photographs


@dataclass(frozen=True)
class PairSource:
    """What pairs are drawn from; small enough to be sent to worker processes."""

    meshes: tuple[Path, ...]
    mesh_unit: Literal["m", "mm"]
    photos: Path | None
    photo_limit: int | None
    shapes: int
    pairs: PairConfig

    def load_photos(self, random: np.random.Generator) -> list[np.ndarray]:
        """The photographs of the folder, or generated pictures."""
        if self.photos is not None:
            return load_photos(Path(self.photos), self.photo_limit)
        return [procedural_photo(random, (200, 260)) for _ in range(MADE_PHOTOS)]

    def load_meshes(self) -> list[Mesh]:
        """The meshes of the files."""
        return [Mesh.load(path, unit=self.mesh_unit) for path in self.meshes]


class PairDataModule(pl.LightningDataModule):
    """Batches of `TrainingBatch`.

    Args:
        meshes: folder of training meshes, or None for random shapes alone.
        mesh_unit: unit of those meshes.
        holdout: how many of them (evenly spread) validate instead of training.
        photos: folder of background photographs, or None for generated pictures.
        photo_limit: photographs kept in memory at most.
        shapes: random shapes with photo textures beside the meshes.
        renew_every: batches after which one random shape is replaced by a new one.
        batch_size: pairs a batch.
        workers: processes that draw pairs.
        validation_batches: fixed batches of pairs for validation.
        seed: of everything random; a resumed run goes on with pairs not seen before.
        pairs: all that is random about a pair.
    """

    def __init__(
        self,
        meshes: Path | None = None,
        mesh_unit: Literal["m", "mm"] = "m",
        holdout: int = 8,
        photos: Path | None = None,
        photo_limit: int | None = None,
        shapes: int = 60,
        renew_every: int = 50,
        batch_size: int = 32,
        workers: int = 1,
        validation_batches: int = 8,
        seed: int = 0,
        pairs: PairConfig | None = None,
    ) -> None:
        super().__init__()
        self.folder, self.mesh_unit, self.holdout = meshes, mesh_unit, holdout
        self.photos, self.photo_limit = photos, photo_limit
        self.shapes, self.renew_every = shapes, renew_every
        self.batch_size, self.workers = batch_size, workers
        self.validation_batches, self.seed = validation_batches, seed
        self.pairs = pairs or PairConfig()
        self._validation: list[TrainingBatch] = []

    def mesh_paths(self) -> tuple[list[Path], list[Path]]:
        """Paths of the training and of the held-out meshes."""
        if self.folder is None:
            return [], []
        folder = Path(self.folder)
        paths = sorted(p for p in folder.glob("*") if p.suffix.lower() in MESH_SUFFIXES)
        if len(paths) <= self.holdout:
            raise InputError(
                f"Mesh folder {folder} holds {len(paths)} .glb, .obj, .ply or .stl files; with "
                f"holdout {self.holdout} more are needed."
            )
        every = len(paths) // self.holdout if self.holdout else len(paths) + 1
        held = set(paths[every // 2 :: every][: self.holdout])
        return [p for p in paths if p not in held], [p for p in paths if p in held]

    def train_dataloader(self) -> DataLoader[TrainingBatch]:
        """Pairs without end; the seed depends on the step, so that resuming sees new ones."""
        step = self.trainer.global_step if self.trainer else 0
        source = self._source(self.mesh_paths()[0])
        stream = PairStream(source, self.batch_size, self.renew_every, (self.seed, step))
        return DataLoader(
            stream,
            batch_size=None,
            num_workers=self.workers,
            prefetch_factor=6 if self.workers else None,
            persistent_workers=self.workers > 0,
        )

    def val_dataloader(self) -> DataLoader[TrainingBatch]:
        """The same few batches each time, of objects that are not trained on."""
        if not self._validation:
            source = self._source(self.mesh_paths()[1])
            random = np.random.default_rng(self.seed + 1)
            photos = source.load_photos(random)
            meshes = source.load_meshes() or [random_object(random, photos) for _ in range(8)]
            generator = PairGenerator(meshes, photos, self.pairs, self.seed + 1)
            self._validation = [
                generator.batch(self.batch_size) for _ in range(self.validation_batches)
            ]
        return DataLoader(_Fixed(self._validation), batch_size=None)

    def _source(self, paths: list[Path]) -> PairSource:
        shapes = self.shapes if paths else max(1, self.shapes)
        return PairSource(
            tuple(paths), self.mesh_unit, self.photos, self.photo_limit, shapes, self.pairs
        )


class PairStream(IterableDataset[TrainingBatch]):
    """Batches without end, drawn in a worker process; each worker and seed draws others."""

    def __init__(
        self, source: PairSource, batch_size: int, renew_every: int, seed: tuple[int, int]
    ) -> None:
        super().__init__()
        self.source, self.batch_size = source, batch_size
        self.renew_every, self.seed = renew_every, seed

    def __iter__(self) -> Iterator[TrainingBatch]:
        worker = get_worker_info()
        if worker is not None:
            torch.set_num_threads(1)
        random = np.random.default_rng([*self.seed, worker.id if worker else 0])
        photos, meshes = self.source.load_photos(random), self.source.load_meshes()
        fixed = len(meshes)
        meshes += [random_object(random, photos) for _ in range(self.source.shapes)]
        seed = int(random.integers(2**62))
        generator = PairGenerator(meshes, photos, self.source.pairs, seed)
        count = 0
        while True:
            count += 1
            if len(meshes) > fixed and count % self.renew_every == 0:
                meshes[int(random.integers(fixed, len(meshes)))] = random_object(random, photos)
            yield generator.batch(self.batch_size)


class _Fixed(Dataset[TrainingBatch]):
    def __init__(self, batches: list[TrainingBatch]) -> None:
        self.batches = batches

    def __len__(self) -> int:
        return len(self.batches)

    def __getitem__(self, index: int) -> TrainingBatch:
        return self.batches[index]
