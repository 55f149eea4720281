"""Training pairs as a Lightning data module: drawn in worker processes, without end, or read.

Never trains. Without folders it draws objects and photos that the project's own code makes, so
that a fit runs on a fresh machine. With several training processes each has pairs of its own.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytorch_lightning as pl
import torch
from torch import Tensor
from torch.utils.data import DataLoader, Dataset, IterableDataset

from moveit6d.config.ranges import RANGES
from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Unit
from moveit6d.networks.weights_file import WEIGHTS_NAME, load_network
from moveit6d.observation import Observation
from moveit6d.synthesis.training.pairs import PairConfig, TrainingBatch
from moveit6d.synthesis.training.shards import check_no_templates, written_crop, written_digest
from moveit6d.synthesis.training.source import PairSource, mesh_files

from .bank_pairs import BankStream
from .pair_streams import PairStream, RolloutConfig, WrittenStream, check_leads

# Pairs a batch, which a CPU draws, also where it does not draw training pairs. No setting: figures
# are means over all pairs, and how many these are is set by `validation_batches`.
LARGEST_VALIDATION = 32


class PairDataModule(pl.LightningDataModule):
    """Batches of `TrainingBatch`.

    Args:
        meshes: folder of training meshes, or None for random shapes alone.
        mesh_unit: unit of those meshes: m, cm, mm or in.
        holdout: how many of them (evenly spread) validate instead of training.
        photos: folder of background photographs, or None for generated pictures.
        photo_limit: photographs kept in memory at most.
        occluders: folder of meshes for the bank of occluders; None: the training meshes.
        shapes: random shapes with photo textures beside the meshes.
        symmetric: share of those that are symmetric and say so.
        untextured: share of those that are copies of the meshes without their texture.
        slender: share of those that are squeezed copies of the meshes and of other shapes.
        renew_every: batches after which one random shape is replaced by a new one; 0: never, then
            they are those of `seed` from beginning to end, and validate where there are no meshes.
            With `device` cuda, as soon as a new one is made.
        written: folder of `moveit6d write-pairs`; None: pairs are drawn as training goes.
        dihedral: written pairs are shown in one of their eight dihedral views, a new one each time:
            so few pairs are not learnt by heart.
        batch_size: pairs a batch, in each training process.
        workers: processes that draw pairs.
        validation_batches: fixed batches for validation, each of `batch_size` pairs, but of 32 at
            most.
        seed: of everything random; a resumed run goes on with pairs not seen before.
        pairs: all that is random about a pair.
        rollouts: whether, and how, states that the network itself leads to are trained on.
        device: `cpu`: worker processes draw pairs; `cuda`: the GPU draws them itself, in batches:
            not with `written`, `occluders`, `rollouts.weights` or random shapes that stay.
    """

    def __init__(
        self,
        meshes: Path | None = None,
        mesh_unit: Unit = "m",
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
        for name, share in {
            "symmetric": symmetric, "untextured": untextured, "slender": slender
        }.items():  # fmt: skip
            if not RANGES["from 0 to 1"](share):
                raise InputError(f"data.{name} is {share}, must be from 0 to 1.")
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

    def setup(self, stage: str) -> None:
        """`InputError` where pairs are to be drawn on a GPU that is not there.

        With trainer.limit_train_batches there are several epochs: each gets a loader of its own,
        which begins where the fit is then, so that no epoch shows another one's pairs. With
        trainer.overfit_batches they are meant to be the same.
        """
        trainer: Any = self.trainer
        if trainer is not None and not trainer.overfit_batches:
            trainer.reload_dataloaders_every_n_epochs = 1
        if self.device == "cuda" and not torch.cuda.is_available():
            raise InputError(
                "data.device is cuda, but PyTorch finds no NVIDIA GPU here: set data.device to cpu "
                "(with configs/overlay/gpu_pairs.yaml: leave that out)."
            )

    def facts(self) -> dict[str, Any]:
        """What a fit that goes on cannot change of its pairs, by the options' names.

        Not by whom they are drawn and how many at once.
        """
        if self.written is not None:
            own = {"written": written_digest(self.written), "dihedral": self.dihedral}
        else:
            own = self.source().facts()
            del own["lasting"]  # of seed and renew_every
            own["renew_every"], own["written"] = self.renew_every, None
            own["rollouts.iterations"] = self.rollouts.iterations
        return {f"data.{name}": value for name, value in {**own, "seed": self.seed}.items()}

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
        held = {paths[number] for number in _spread(len(paths), self.holdout)}
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
                self._accumulated(),
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
            others = source if source.lasting is not None else replace(source, shapes=8)
            meshes = source.load_meshes() or others.make_shapes(random, photos)
            generator = source.generator(random, photos, meshes, source.load_occluders())
            size = min(self.batch_size, LARGEST_VALIDATION)
            self._validation = [generator.batch(size) for _ in range(self.validation_batches)]
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
            None if self.renew_every else self.seed,
        )

    def _written_stream(self, folder: Path) -> WrittenStream:
        if self.rollouts.iterations:
            raise InputError(
                "Rollouts need meshes to render, and written pairs have none: set "
                "data.rollouts.iterations to 0 or data.written to null."
            )
        check_no_templates(self.pairs, " or data.written to null")
        crop = written_crop(folder)
        if crop != self.pairs.crop:
            raise InputError(
                f"{folder} holds pairs with {crop} crops, and data.pairs.crop is "
                f"{self.pairs.crop}: set it to {crop}, or write such pairs."
            )
        used = self._step() * self._accumulated()
        return WrittenStream(
            folder, self.batch_size, self.seed, used, self._rank(), self._processes(), self.dihedral
        )

    def _rollouts(self) -> RolloutConfig:
        """With the file to read; `InputError` for one that is not there, or leads nowhere."""
        weights, iterations = self.rollouts.weights, self.rollouts.iterations
        if weights is None and self.trainer:
            own = Path(self.trainer.default_root_dir) / WEIGHTS_NAME
            return replace(self.rollouts, weights=own)
        if weights is not None and iterations:
            if not weights.is_file():
                raise InputError(
                    f"data.rollouts.weights: {weights} does not exist; give a weights file, or "
                    "null for those that this fit exports."
                )
            check_leads(load_network(weights).network)
        return self.rollouts

    def _accumulated(self) -> int:
        """Batches that a training step takes."""
        return self.trainer.accumulate_grad_batches if self.trainer else 1

    def _step(self) -> int:
        return self.trainer.global_step if self.trainer else 0

    def _rank(self) -> int:
        return self.trainer.global_rank if self.trainer else 0

    def _processes(self) -> int:
        return self.trainer.world_size if self.trainer else 1


def _spread(count: int, few: int) -> list[int]:
    """Numbers below `count`, so few of them, evenly spread."""
    every = count // few if few else 0
    if every >= few:  # what is left over at the end is less than a step
        return [every // 2 + number * every for number in range(few)]
    return [(2 * number + 1) * count // (2 * few) for number in range(few)]


class _Fixed(Dataset[TrainingBatch]):
    def __init__(self, batches: list[TrainingBatch]) -> None:
        self.batches = batches

    def __len__(self) -> int:
        return len(self.batches)

    def __getitem__(self, index: int) -> TrainingBatch:
        return self.batches[index]
