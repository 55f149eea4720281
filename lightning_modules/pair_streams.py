"""Streams of training batches: drawn in worker processes, or read from shards.

Never trains. With rollouts a stream also shows the states that a network leads to.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path

import numpy as np
import torch
from torch import Tensor
from torch.utils.data import IterableDataset, get_worker_info

from moveit6d.errors import InputError
from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.inference import InferenceNetwork
from moveit6d.networks.kinds import PoseNet
from moveit6d.networks.weights_file import load_network
from moveit6d.observation import Observation
from moveit6d.synthesis.training.dihedral import dihedral_view
from moveit6d.synthesis.training.pairs import TrainingBatch
from moveit6d.synthesis.training.shards import shard_stream
from moveit6d.synthesis.training.source import PairSource


@dataclass(frozen=True)
class RolloutConfig:
    """Training on the states that the network itself leads to.

    After each batch of new images `iterations` more show the same ones, each after one more
    iteration of the network: on a GPU of the one in training, else of the one in `weights`
    (.safetensors; None: what this fit itself exports), which is read anew whenever it changes.
    With 0 iterations, or before this fit has exported anything, there are no such batches.
    """

    weights: Path | None = None
    iterations: int = 0
    first_step: int = 1000  # training step from which there are such batches


def check_leads(network: PoseNet) -> None:
    """`InputError` for a network whose answers lead to no state: one that chooses an action."""
    if isinstance(network, ActionNet):
        raise InputError(
            "Rollouts need a network that answers for all six axes, and an ActionNet chooses one "
            "of 13 actions: set data.rollouts.iterations to 0."
        )


class PairStream(IterableDataset[TrainingBatch]):
    """Batches without end, drawn in a worker process; each worker and seed draws others.

    `seed` is that of the fit and the training step, `first` the number of the first of this
    training process's workers among everybody's; a step takes `accumulated` batches.
    """

    def __init__(
        self,
        source: PairSource,
        batch_size: int,
        renew_every: int,
        seed: tuple[int, int],
        rollouts: RolloutConfig | None = None,
        first: int = 0,
        accumulated: int = 1,
    ) -> None:
        super().__init__()
        self.source, self.batch_size = source, batch_size
        self.renew_every, self.seed, self.first = renew_every, seed, first
        self.rollouts, self.accumulated = rollouts or RolloutConfig(), accumulated

    def __iter__(self) -> Iterator[TrainingBatch]:
        worker = get_worker_info()
        if worker is not None:
            torch.set_num_threads(1)
        number, workers = (worker.id, worker.num_workers) if worker else (0, 1)
        random = np.random.default_rng([*self.seed, self.first + number])
        photos, meshes = self.source.load_photos(random), self.source.load_meshes()
        fixed, files = len(meshes), tuple(meshes)
        meshes += self.source.make_shapes(random, photos, files)
        occluders = self.source.load_occluders()
        generator = self.source.generator(random, photos, meshes, occluders)
        student = _Student(self.rollouts)
        # Workers are asked in turn, so each knows at which step its next batch will be used.
        given = number
        for drawn in count(1):
            if len(meshes) > fixed and self.renew_every and drawn % self.renew_every == 0:
                place = int(random.integers(fixed, len(meshes)))
                meshes[place] = self.source.shape(random, photos, files)
            batch = generator.batch(self.batch_size)
            yield batch
            given += workers
            step = self.seed[1] + given // self.accumulated
            for _ in range(self.rollouts.iterations if student.ready(step) else 0):
                batch = generator.advance(batch, student.delta(batch.observation))
                yield batch
                given += workers


class WrittenStream(IterableDataset[TrainingBatch]):
    """Batches without end from shards; processes and workers share each epoch's shards out.

    `used` is the number of batches that this training process has used before.
    """

    def __init__(
        self, folder: Path, batch_size: int, seed: int, used: int, rank: int, processes: int,
        dihedral: bool = False,
    ) -> None:  # fmt: skip
        super().__init__()
        self.folder, self.batch_size, self.seed = Path(folder), batch_size, seed
        self.used, self.rank, self.processes = used, rank, processes
        self.dihedral = dihedral

    def __iter__(self) -> Iterator[TrainingBatch]:
        worker = get_worker_info()
        number, workers = (worker.id, worker.num_workers) if worker else (0, 1)
        # Workers are asked in turn, so each has given an equal part of what was used so far.
        skip = (self.used + workers - 1 - number) // workers
        reader, readers = self.rank * workers + number, self.processes * workers
        batches = shard_stream(self.folder, self.batch_size, self.seed, reader, readers, skip)
        return self._views(batches, reader) if self.dihedral else batches

    def _views(self, batches: Iterator[TrainingBatch], reader: int) -> Iterator[TrainingBatch]:
        random = np.random.default_rng([self.seed, self.used, reader])
        for batch in batches:
            yield dihedral_view(batch, int(random.integers(4)), bool(random.integers(2)))


class _Student:
    """The network as it was last exported, or nobody."""

    def __init__(self, config: RolloutConfig) -> None:
        self.config = config
        self.network: InferenceNetwork | None = None
        self.changed = 0.0

    def ready(self, step: int) -> bool:
        """Whether there is a network to ask in a training step; reads it if it is new."""
        path, config = self.config.weights, self.config
        if not config.iterations or step < config.first_step or path is None:
            return False
        if not Path(path).exists():
            return False
        changed = Path(path).stat().st_mtime
        if self.network is None or changed != self.changed:
            network = load_network(Path(path)).network
            check_leads(network)
            self.network, self.changed = InferenceNetwork(network), changed
        return True

    def delta(self, observation: Observation) -> Tensor:
        """Its pose deltas (B, 6) for a batch."""
        assert self.network is not None
        delta = self.network(observation).delta
        assert delta is not None
        return delta
