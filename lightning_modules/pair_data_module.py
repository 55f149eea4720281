"""Training pairs as a Lightning data module: drawn in worker processes, without end, or read.

Never trains. Without folders it draws objects and photos that the project's own code makes, so
that a fit runs on a fresh machine. With several training processes each has pairs of its own.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import count
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytorch_lightning as pl
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, IterableDataset, get_worker_info

from moveit6d.errors import InputError
from moveit6d.networks.inference import InferenceNetwork
from moveit6d.networks.weights_file import WEIGHTS_NAME, load_network
from moveit6d.observation import Observation
from moveit6d.synthesis.training.dihedral import dihedral_view
from moveit6d.synthesis.training.pairs import PairConfig, TrainingBatch
from moveit6d.synthesis.training.shards import check_no_templates, shard_stream
from moveit6d.synthesis.training.source import PairSource, mesh_files

from .bank_pairs import BankStream


@dataclass(frozen=True)
class RolloutConfig:
    """Training on the states that the network itself leads to.

    After each batch of new images `iterations` more show the same ones, each after one more
    iteration of the network: on a GPU of the one in training, else of the one in `weights`
    (.safetensors; None: what this fit itself exports), which is read anew whenever it changes.
    Without such a file, or with 0 iterations, there are no such batches.
    """

    weights: Path | None = None
    iterations: int = 0
    first_step: int = 1000  # training step from which there are such batches


class PairDataModule(pl.LightningDataModule):
    """Batches of `TrainingBatch`.

    Args:
        meshes: folder of training meshes, or None for random shapes alone.
        mesh_unit: unit of those meshes.
        holdout: how many of them (evenly spread) validate instead of training.
        photos: folder of background photographs, or None for generated pictures.
        photo_limit: photographs kept in memory at most.
        occluders: folder of meshes for the bank of occluders; None: the training meshes.
        shapes: random shapes with photo textures beside the meshes.
        symmetric: share of those that are symmetric and say so.
        untextured: share of those that are copies of the meshes without their texture.
        slender: share of those that are squeezed copies of the meshes and of other shapes.
        renew_every: batches after which one random shape is replaced by a new one; 0: never. With
            `device` cuda, as soon as a new one is made.
        written: folder of `moveit6d write-pairs`; None: pairs are drawn as training goes.
        dihedral: written pairs are shown in one of their eight dihedral views, a new one each time:
            so few pairs are not learnt by heart.
        batch_size: pairs a batch, in each training process.
        workers: processes that draw pairs.
        validation_batches: fixed batches of pairs for validation.
        seed: of everything random; a resumed run goes on with pairs not seen before.
        pairs: all that is random about a pair.
        rollouts: whether, and how, states that the network itself leads to are trained on.
        device: `cpu`: worker processes draw pairs; `cuda`: the GPU draws them itself, in batches:
            not with `written`, `occluders`, `rollouts.weights` or random shapes that stay.
    """

    def __init__(
        self,
        meshes: Path | None = None,
        mesh_unit: Literal["m", "mm"] = "m",
        holdout: int = 8,
        photos: Path | None = None,
        photo_limit: int | None = None,
        occluders: Path | None = None,
        shapes: int = 60,
        symmetric: float = 0.0,
        untextured: float = 0.0,
        slender: float = 0.0,
        renew_every: int = 50,
        written: Path | None = None,
        dihedral: bool = False,
        batch_size: int = 32,
        workers: int = 1,
        validation_batches: int = 8,
        seed: int = 0,
        pairs: PairConfig = PairConfig(),  # noqa: B008 (frozen)
        rollouts: RolloutConfig | None = None,
        device: Literal["cpu", "cuda"] = "cpu",
    ) -> None:
        super().__init__()
        least = {"batch_size": 1, "validation_batches": 1}
        counts = {
            "batch_size": batch_size, "validation_batches": validation_batches, "holdout": holdout,
            "shapes": shapes, "renew_every": renew_every, "workers": workers, "seed": seed,
        }  # fmt: skip
        for name, value in counts.items():
            if value < least.get(name, 0):
                raise InputError(f"data.{name} is {value}, must be {least.get(name, 0)} or more.")
        if dihedral and written is None:
            raise InputError("data.dihedral is for written pairs: set data.written, too.")
        self.folder, self.mesh_unit, self.holdout = meshes, mesh_unit, holdout
        self.photos, self.photo_limit = photos, photo_limit
        self.occluders, self.written, self.dihedral = occluders, written, dihedral
        self.shapes, self.symmetric, self.untextured = shapes, symmetric, untextured
        self.slender = slender
        self.renew_every = renew_every
        self.batch_size, self.workers = batch_size, workers
        self.validation_batches, self.seed = validation_batches, seed
        self.pairs = pairs
        self.rollouts = rollouts or RolloutConfig()
        self.device = device
        self._validation: list[TrainingBatch] = []

    def mesh_paths(self) -> tuple[list[Path], list[Path]]:
        """Paths of the training and of the held-out meshes."""
        if self.folder is None:
            return [], []
        paths = mesh_files(self.folder)
        if len(paths) <= self.holdout:
            raise InputError(
                f"Mesh folder {self.folder} holds {len(paths)} mesh files; "
                f"with holdout {self.holdout} more are needed."
            )
        every = len(paths) // self.holdout if self.holdout else len(paths) + 1
        held = set(paths[every // 2 :: every][: self.holdout])
        return [p for p in paths if p not in held], [p for p in paths if p in held]

    def train_dataloader(self) -> DataLoader[TrainingBatch]:
        """Pairs without end; a resumed training sees new ones, and each process its own."""
        stream: IterableDataset[TrainingBatch]
        if self.device == "cuda":
            return DataLoader(self._bank_stream(), batch_size=None)
        if self.written is not None:
            stream = self._written_stream(self.written)
        else:
            stream = PairStream(
                self.source(),
                self.batch_size,
                self.renew_every,
                (self.seed, self._step()),
                self._rollouts(),
                self._rank() * max(1, self.workers),
            )
        return DataLoader(
            stream,
            batch_size=None,
            num_workers=self.workers,
            prefetch_factor=6 if self.workers else None,
            persistent_workers=self.workers > 0,
        )

    def _bank_stream(self) -> BankStream:
        """Pairs that the GPU draws; `InputError` for options that have no effect on them."""
        source = self.source()
        without_effect = {
            "data.written is set": (self.written is not None, "null"),
            "data.occluders is set": (self.occluders is not None, "null"),
            "data.rollouts.weights is set": (self.rollouts.weights is not None, "null"),
            "data.renew_every is 0": (not self.renew_every and source.shapes > 0, "50"),
        }
        for option, (is_so, value) in without_effect.items():
            if is_so:
                raise InputError(
                    f"{option}, which has no effect where the GPU draws pairs: set "
                    f"{option.split()[0]} to {value} or data.device to cpu."
                )
        return BankStream(
            source, self.batch_size, (self.seed, self._step(), self._rank()),
            torch.device("cuda"), self.rollouts.iterations, self._own_delta,
        )  # fmt: skip

    @torch.no_grad()
    def _own_delta(self, observation: Observation) -> Tensor | None:
        """What the network in training predicts; None in its first steps."""
        trainer = self.trainer
        assert trainer is not None
        if trainer.global_step < self.rollouts.first_step:
            return None
        network: Any = trainer.lightning_module.network
        network.eval()
        image = observation.image
        with torch.autocast(image.device.type, torch.bfloat16, image.is_cuda):
            delta: Tensor = network(observation).prediction.delta
        network.train()
        return delta.float()

    def val_dataloader(self) -> DataLoader[TrainingBatch]:
        """The same few batches each time, of held-out objects, or of all if none is held out."""
        if not self._validation:
            train, held = self.mesh_paths()
            source = self._source(held or train)
            random = np.random.default_rng(self.seed + 1)
            photos = source.load_photos(random)
            meshes = source.load_meshes() or [source.shape(random, photos) for _ in range(8)]
            generator = source.generator(random, photos, meshes, source.load_occluders())
            self._validation = [
                generator.batch(self.batch_size) for _ in range(self.validation_batches)
            ]
        return DataLoader(_Fixed(self._validation), batch_size=None)

    def source(self) -> PairSource:
        """What training pairs are drawn from."""
        return self._source(self.mesh_paths()[0])

    def _source(self, paths: list[Path]) -> PairSource:
        shapes = self.shapes if paths else max(1, self.shapes)
        others = mesh_files(self.occluders) if self.occluders is not None else []
        return PairSource(
            tuple(paths),
            self.mesh_unit,
            self.photos,
            self.photo_limit,
            shapes,
            self.pairs,
            self.symmetric,
            tuple(others),
            self.untextured,
            self.slender,
        )

    def _written_stream(self, folder: Path) -> WrittenStream:
        if self.rollouts.iterations:
            raise InputError(
                "Rollouts need meshes to render, and written pairs have none: set "
                "data.rollouts.iterations to 0 or data.written to null."
            )
        check_no_templates(self.pairs, " or data.written to null")
        return WrittenStream(
            folder, self.batch_size, self.seed, self._step(), self._rank(), self._processes(),
            self.dihedral,
        )  # fmt: skip

    def _rollouts(self) -> RolloutConfig:
        if self.rollouts.weights is None and self.trainer:
            own = Path(self.trainer.default_root_dir) / WEIGHTS_NAME
            return replace(self.rollouts, weights=own)
        return self.rollouts

    def _step(self) -> int:
        return self.trainer.global_step if self.trainer else 0

    def _rank(self) -> int:
        return self.trainer.global_rank if self.trainer else 0

    def _processes(self) -> int:
        return self.trainer.world_size if self.trainer else 1


class PairStream(IterableDataset[TrainingBatch]):
    """Batches without end, drawn in a worker process; each worker and seed draws others.

    `first` is the number of the first of this training process's workers among everybody's.
    """

    def __init__(
        self,
        source: PairSource,
        batch_size: int,
        renew_every: int,
        seed: tuple[int, int],
        rollouts: RolloutConfig | None = None,
        first: int = 0,
    ) -> None:
        super().__init__()
        self.source, self.batch_size = source, batch_size
        self.renew_every, self.seed, self.first = renew_every, seed, first
        self.rollouts = rollouts or RolloutConfig()

    def __iter__(self) -> Iterator[TrainingBatch]:
        worker = get_worker_info()
        if worker is not None:
            torch.set_num_threads(1)
        random = np.random.default_rng([*self.seed, self.first + (worker.id if worker else 0)])
        photos, meshes = self.source.load_photos(random), self.source.load_meshes()
        fixed, files = len(meshes), tuple(meshes)
        meshes += [self.source.shape(random, photos, files) for _ in range(self.source.shapes)]
        occluders = self.source.load_occluders()
        generator = self.source.generator(random, photos, meshes, occluders)
        student = _Student(self.rollouts)
        for number in count(1):
            if len(meshes) > fixed and self.renew_every and number % self.renew_every == 0:
                place = int(random.integers(fixed, len(meshes)))
                meshes[place] = self.source.shape(random, photos, files)
            batch = generator.batch(self.batch_size)
            yield batch
            for _ in range(student.iterations if student.ready() else 0):
                batch = generator.advance(batch, student.delta(batch.observation))
                yield batch


class WrittenStream(IterableDataset[TrainingBatch]):
    """Batches without end from shards; processes and workers share each epoch's shards out."""

    def __init__(
        self, folder: Path, batch_size: int, seed: int, step: int, rank: int, processes: int,
        dihedral: bool = False,
    ) -> None:  # fmt: skip
        super().__init__()
        self.folder, self.batch_size, self.seed = Path(folder), batch_size, seed
        self.step, self.rank, self.processes = step, rank, processes
        self.dihedral = dihedral

    def __iter__(self) -> Iterator[TrainingBatch]:
        worker = get_worker_info()
        number, workers = (worker.id, worker.num_workers) if worker else (0, 1)
        # Workers are asked in turn, so each has given an equal part of what was used so far.
        skip = (self.step + workers - 1 - number) // workers
        reader, readers = self.rank * workers + number, self.processes * workers
        batches = shard_stream(self.folder, self.batch_size, self.seed, reader, readers, skip)
        return self._views(batches, reader) if self.dihedral else batches

    def _views(self, batches: Iterator[TrainingBatch], reader: int) -> Iterator[TrainingBatch]:
        random = np.random.default_rng([self.seed, self.step, reader])
        for batch in batches:
            yield dihedral_view(batch, int(random.integers(4)), bool(random.integers(2)))


class _Student:
    """The network as it was last exported, or nobody."""

    def __init__(self, config: RolloutConfig) -> None:
        self.path, self.iterations = config.weights, config.iterations
        self.network: InferenceNetwork | None = None
        self.changed = 0.0

    def ready(self) -> bool:
        """Whether there is a network to ask; reads it if it is new."""
        if not self.iterations or self.path is None or not Path(self.path).exists():
            return False
        changed = Path(self.path).stat().st_mtime
        if self.network is None or changed != self.changed:
            self.network = InferenceNetwork(load_network(Path(self.path)).network)
            self.changed = changed
        return True

    def delta(self, observation: Observation) -> Tensor:
        """Its pose deltas (B, 6) for a batch."""
        assert self.network is not None
        delta = self.network(observation).delta
        if delta is None:
            raise InputError("Rollouts need a network that answers for all six axes.")
        return delta


class _Fixed(Dataset[TrainingBatch]):
    def __init__(self, batches: list[TrainingBatch]) -> None:
        self.batches = batches

    def __len__(self) -> int:
        return len(self.batches)

    def __getitem__(self, index: int) -> TrainingBatch:
        return self.batches[index]
