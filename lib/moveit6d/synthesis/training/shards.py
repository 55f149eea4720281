"""Training pairs on disk, in shards that machines can share out among them.

Never trains. What a shard holds depends on the source, the seed and the shard's number alone, not
on who writes it or what was written before; a shard is there as a whole or not at all. So parts of
a job can run anywhere, be killed at any time and be started again.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from ...checks import entry, whole
from ...errors import InputError
from ...geometry.crop import Crop
from ...geometry.mesh import Mesh
from ...io import file_digest, read_json, replacing, write_json
from ...observation import Observation
from ..imaging.sensor import to_bytes
from .pairs import PairConfig, TrainingBatch
from .source import PairSource

MANIFEST = "pairs.json"
FORMAT = "moveit6d-pairs-3"


@dataclass(frozen=True)
class ShardPlan:
    """How many shards of how many batches of how many pairs there are, and their seed."""

    shards: int
    batches: int = 32
    batch_size: int = 32
    seed: int = 0

    def part(self, number: int, count: int) -> list[int]:
        """The shards of part `number` (from 1) of `count`: every `count`-th one."""
        if not 1 <= number <= count:
            raise InputError(f"There is no part {number} of {count}; parts count from 1.")
        return list(range(number - 1, self.shards, count))


def shard_path(folder: Path, number: int, plan: ShardPlan) -> Path:
    """The file of a shard."""
    return Path(folder) / f"{number:05d}-of-{plan.shards:05d}.safetensors"


def check_no_templates(pairs: PairConfig, or_else: str = "") -> None:
    """`InputError` for pairs with templates, which shards do not hold.

    `or_else` says what else may be set.
    """
    if pairs.views.share > 0:
        raise InputError(
            f"data.pairs.views.share is {pairs.views.share}, but written pairs hold no templates "
            f"for descriptors: set data.pairs.views.share to 0{or_else}."
        )


class ShardWriter:
    """Writes shards of one plan; loads files once, however many shards it writes.

    `InputError` for pairs with templates (`ViewConfig`), which shards do not hold.
    """

    def __init__(self, source: PairSource, plan: ShardPlan, folder: Path) -> None:
        check_no_templates(source.pairs)
        self.source, self.plan, self.folder = source, plan, Path(folder)
        self._loaded: tuple[list[np.ndarray], list[Mesh], list[Mesh] | None] | None = None

    def claim(self) -> None:
        """Write the manifest, or `InputError` if the folder belongs to other pairs."""
        facts = {"format": FORMAT, **dataclasses.asdict(self.plan), "source": self.source.digest()}
        path = self.folder / MANIFEST
        if not path.exists():
            write_json(path, facts)  # everybody writes the same
        found = read_json(path)
        different = [key for key, value in facts.items() if found.get(key) != value]
        if different:
            raise InputError(
                f"{self.folder} holds pairs of another {different[0]}; give the arguments that "
                "they were begun with, or another folder."
            )

    def missing(self, numbers: Sequence[int]) -> list[int]:
        """Those of the shards that are not there yet."""
        return [n for n in numbers if not shard_path(self.folder, n, self.plan).exists()]

    def write(self, number: int) -> Path:
        """Draw and write one shard."""
        torch.set_num_threads(1)  # sums in another order are other numbers
        photos, fixed, occluders = self._things()
        random = np.random.default_rng([self.plan.seed, number])
        meshes = fixed + self.source.make_shapes(random, photos, fixed)
        generator = self.source.generator(random, photos, meshes, occluders)
        packed = [_packed(generator.batch(self.plan.batch_size)) for _ in range(self.plan.batches)]
        tensors = {
            name: torch.cat([one[name] for one in packed]).contiguous() for name in packed[0]
        }
        path = shard_path(self.folder, number, self.plan)
        with replacing(path) as temporary:
            # One entry: several would stand in a random order, and the same shard be other bytes.
            save_file(tensors, temporary, {"format": FORMAT})
        return path

    def _things(self) -> tuple[list[np.ndarray], list[Mesh], list[Mesh] | None]:
        if self._loaded is None:
            photos = self.source.load_photos(np.random.default_rng(self.plan.seed))
            self._loaded = photos, self.source.load_meshes(), self.source.load_occluders()
        return self._loaded


_writers: dict[tuple[Path, ShardPlan], ShardWriter] = {}


def write_shard(task: tuple[PairSource, ShardPlan, Path, int]) -> Path:
    """One shard as a task of a worker process, which keeps what it has loaded for the next one."""
    source, plan, folder, number = task
    writer = _writers.get((folder, plan))
    if writer is None or writer.source != source:
        writer = _writers[folder, plan] = ShardWriter(source, plan, folder)
    return writer.write(number)


def open_shards(folder: Path) -> tuple[ShardPlan, list[Path]]:
    """The plan of a folder and its shards; `InputError` names those that are missing."""
    folder = Path(folder)
    if not (folder / MANIFEST).is_file():
        raise InputError(f"{folder} has no {MANIFEST}; `moveit6d write-pairs` makes such folders.")
    facts = read_json(folder / MANIFEST)
    if facts.get("format") != FORMAT:
        raise InputError(f"{folder / MANIFEST}: format {facts.get('format')!r}, not {FORMAT!r}.")
    fields = [field.name for field in dataclasses.fields(ShardPlan)]
    where = str(folder / MANIFEST)
    plan = ShardPlan(
        **{name: whole(entry(facts, name, where), f"{where}: {name}") for name in fields}
    )
    there = sum(path.suffix == ".safetensors" for path in folder.iterdir())
    if min(plan.shards, plan.batches, plan.batch_size) < 1:
        raise InputError(f"{where}: shards, batches and batch_size must be above 0.")
    if plan.shards > there:
        raise InputError(
            f"{folder} lacks {plan.shards - there} of its {plan.shards} shards; run `moveit6d "
            "write-pairs` again for the parts that are not finished."
        )
    paths = [shard_path(folder, number, plan) for number in range(plan.shards)]
    missing = [path.name for path in paths if not path.exists()]
    if missing:
        raise InputError(
            f"{folder} lacks {len(missing)} of its {plan.shards} shards, {missing[0]} first; run "
            "`moveit6d write-pairs` again for the parts that are not finished."
        )
    return plan, paths


def written_digest(folder: Path) -> str:
    """A fingerprint of the pairs in a folder: of what they were drawn from, and how many."""
    open_shards(folder)
    return file_digest(Path(folder) / MANIFEST)


def written_crop(folder: Path) -> Crop:
    """The crops that the pairs in a folder show: in a look-at crop objects lie in one direction."""
    path = open_shards(folder)[1][0]
    with _reading(path), safe_open(path, "pt") as file:
        direction: Tensor = file.get_tensor("direction")
    return "axis_parallel" if direction.any() else "look_at"


def read_shard(path: Path, batch_size: int) -> Iterator[TrainingBatch]:
    """The pairs of a shard in batches; only one is in memory at a time."""
    with _reading(path), safe_open(path, "pt") as file:
        slices = {name: file.get_slice(name) for name in file.keys()}  # noqa: SIM118
        count = slices["delta"].get_shape()[0]
        for start in range(0, count - batch_size + 1, batch_size):
            end = start + batch_size
            yield _unpacked({name: part[start:end] for name, part in slices.items()})


@contextmanager
def _reading(path: Path) -> Iterator[None]:
    try:
        yield
    except (SafetensorError, KeyError, OSError) as error:
        raise InputError(f"{path} is damaged ({error}); delete it and write it again.") from error


def shard_stream(
    folder: Path, batch_size: int, seed: int, reader: int = 0, readers: int = 1, skip: int = 0
) -> Iterator[TrainingBatch]:
    """Batches without end for one of several readers that share each epoch's shards out.

    Every epoch has an order of its own, in which each reader takes every `readers`-th shard; the
    first `skip` batches are left out, which is how a resumed training goes on.
    """
    plan, paths = open_shards(folder)
    each = plan.batches * plan.batch_size // batch_size
    if not each or len(paths) < readers:
        raise InputError(
            f"{folder} has {len(paths)} shards of {plan.batches * plan.batch_size} pairs: too few "
            f"for {readers} readers of batches of {batch_size}."
        )
    epoch = 0
    while True:
        order = np.random.default_rng([seed, epoch]).permutation(len(paths))
        for number in order[reader::readers]:
            if skip >= each:
                skip -= each
                continue
            for index, batch in enumerate(read_shard(paths[number], batch_size)):
                if index >= skip:
                    yield batch
            skip = 0
        epoch += 1


def _packed(batch: TrainingBatch) -> dict[str, Tensor]:
    """Eight bits a colour, a bit a mask, 16 bits a depth in diameters: 170 kB a pair."""
    seen = batch.observation
    return {
        "image": to_bytes(seen.image),
        "rendering": to_bytes(seen.rendering),
        "depth": seen.depth.half(),
        "true_depth": batch.true_depth.half(),
        "mask": _bits(seen.mask),
        "true_mask": _bits(batch.true_mask),
        "clear": _bits(batch.clear),
        "distance": seen.distance,
        "delta": batch.delta,
        "mesh": batch.mesh,
        "zoom": batch.zoom,
        "rotation": batch.rotation,
        "direction": batch.direction,
        "present": batch.present,
        "near": batch.near,
    }


def _unpacked(stored: dict[str, Any]) -> TrainingBatch:
    mask, true_mask, clear = (_floats(stored[name]) for name in ("mask", "true_mask", "clear"))
    observation = Observation(
        stored["image"].float() / 255,
        stored["rendering"].float() / 255,
        stored["depth"].float(),
        mask,
        stored["distance"],
    )
    return TrainingBatch(
        observation,
        stored["delta"],
        stored["true_depth"].float(),
        true_mask,
        clear,
        stored["mesh"],
        stored["zoom"],
        stored["rotation"],
        stored["direction"],
        stored["present"],
        stored["near"],
    )


def _bits(mask: Tensor) -> Tensor:
    return torch.from_numpy(np.packbits(mask.numpy() > 0.5, axis=-1))


def _floats(bits: Tensor) -> Tensor:
    return torch.from_numpy(np.unpackbits(bits.numpy(), axis=-1)).float()
