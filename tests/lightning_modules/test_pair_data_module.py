"""The data module: held-out meshes, what its options come to, written pairs, rollouts."""

import dataclasses
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
from lightning_modules.pair_data_module import LARGEST_VALIDATION, PairDataModule
from lightning_modules.pair_streams import PairStream, RolloutConfig, WrittenStream
from moveit6d.errors import InputError
from moveit6d.networks.action_net import ActionConfig, ActionNet
from moveit6d.networks.correlation import CorrelationNet
from moveit6d.networks.weights_file import save_network
from moveit6d.synthesis.training.pairs import PairConfig, PairGenerator, TrainingBatch
from moveit6d.synthesis.training.source import PairSource
from tests.support.pairs import preset


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


@pytest.mark.parametrize(
    ("count", "holdout", "numbers"),
    [
        (174, 8, [10, 31, 52, 73, 94, 115, 136, 157]),  # as for the shipped weights
        (15, 8, [0, 2, 4, 6, 8, 10, 12, 14]),
        (9, 8, [0, 1, 2, 3, 5, 6, 7, 8]),
        (2, 1, [1]),
    ],
)
def test_held_out_meshes_are_evenly_spread_in_small_folders_too(
    tmp_path: Path, count: int, holdout: int, numbers: list[int]
) -> None:
    data = PairDataModule(meshes=folder_of(tmp_path, count), holdout=holdout)
    assert [int(path.stem) for path in data.mesh_paths()[1]] == numbers


@pytest.mark.parametrize("name", ["slender", "symmetric", "untextured"])
@pytest.mark.parametrize("share", [3.0, -0.1, float("nan")])
def test_shares_are_from_0_to_1(name: str, share: float) -> None:
    options: dict[str, Any] = {name: share}
    with pytest.raises(InputError, match=rf"data\.{name} is {share}, must be from 0 to 1"):
        PairDataModule(**options)


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


def drawn_meshes(monkeypatch: pytest.MonkeyPatch) -> list[list[Any]]:
    """The meshes of every generator that is made from now on."""
    found: list[list[Any]] = []
    original = PairGenerator.__init__

    def noted(self: PairGenerator, objects: Any, *rest: Any, **named: Any) -> None:
        found.append(list(objects))
        original(self, objects, *rest, **named)

    monkeypatch.setattr(PairGenerator, "__init__", noted)
    return found


@pytest.mark.parametrize("photos", [True, False])
def test_shapes_that_stay_are_the_same_at_every_step_in_every_process_and_validate(
    source: PairSource, monkeypatch: pytest.MonkeyPatch, photos: bool
) -> None:
    found = drawn_meshes(monkeypatch)
    module = PairDataModule(
        photos=source.photos if photos else None, shapes=0, renew_every=0, batch_size=2,
        workers=0, validation_batches=1, seed=4,
    )  # fmt: skip
    for step, rank in ((0, 0), (250, 1)):
        monkeypatch.setattr(PairDataModule, "_step", lambda _, step=step: step)
        monkeypatch.setattr(PairDataModule, "_rank", lambda _, rank=rank: rank)
        next(iter(module.train_dataloader()))
    module.val_dataloader()
    (first,), *others = found
    assert len(others) == 2
    for (other,) in others:
        assert np.array_equal(first.vertices, other.vertices)
        assert np.array_equal(first.texture, other.texture)


def test_shapes_that_are_renewed_are_each_process_s_own(
    source: PairSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = drawn_meshes(monkeypatch)
    module = PairDataModule(
        photos=source.photos, shapes=1, batch_size=2, workers=0, validation_batches=1
    )
    next(iter(module.train_dataloader()))
    module.val_dataloader()
    (first,), others = found
    assert len(others) == 8 and all(
        one.vertices.shape != first.vertices.shape
        or not np.array_equal(one.vertices, first.vertices)
        for one in others
    )


def test_batches_that_validate_are_no_larger_than_a_cpu_draws(
    source: PairSource, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes: list[int] = []
    monkeypatch.setattr(PairGenerator, "batch", lambda _, size: sizes.append(size))
    PairDataModule(photos=source.photos, batch_size=512, validation_batches=2).val_dataloader()
    assert sizes == [LARGEST_VALIDATION] * 2


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


def test_a_gpu_that_is_not_there_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(torch.cuda, "is_available", lambda: False)
    with pytest.raises(InputError, match=r"data\.device is cuda.*set data\.device to cpu"):
        PairDataModule(device="cuda").setup("fit")


def test_meshes_alone_need_no_renewing_on_the_gpu(tmp_path: Path) -> None:
    module = PairDataModule(
        meshes=folder_of(tmp_path, 1), holdout=0, shapes=0, renew_every=0, device="cuda"
    )
    assert isinstance(module.train_dataloader().dataset, BankStream)


# -- pairs from disk -------------------------------------------------------------------------------


def test_the_loader_reads_every_written_pair_once_in_workers(written: Path) -> None:
    def epoch(workers: int) -> Counter[tuple[float, ...]]:
        module = PairDataModule(written=written, batch_size=2, workers=workers)
        loader = module.train_dataloader()
        return Counter(tuple(b.delta.flatten().tolist()) for b in islice(loader, 8))

    alone = epoch(0)
    assert len(alone) == 8 and set(alone.values()) == {1}
    assert epoch(2) == alone


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


class _Looker(pl.LightningModule):
    """Trains nothing; remembers the pairs that it is shown."""

    def __init__(self) -> None:
        super().__init__()
        self.shown: list[tuple[float, ...]] = []
        self.weight = torch.nn.Parameter(torch.zeros(1))

    def training_step(self, batch: TrainingBatch, _: int) -> torch.Tensor:
        self.shown.append(tuple(batch.delta.flatten().tolist()))
        return self.weight.sum()

    def transfer_batch_to_device(self, batch: Any, *_: Any) -> Any:
        return batch

    def configure_optimizers(self) -> torch.optim.Optimizer:
        return torch.optim.SGD(self.parameters(), lr=0.0)


def shown(
    data: PairDataModule, steps: int, start: Path | None = None, save: Path | None = None,
    **options: Any,
) -> list[tuple[float, ...]]:  # fmt: skip
    """The pairs of a fit, of a step each."""
    module = _Looker()
    training = pl.Trainer(
        accelerator="cpu", logger=False, enable_checkpointing=False, enable_progress_bar=False,
        enable_model_summary=False, max_steps=steps, limit_val_batches=0, **options,
    )  # fmt: skip
    training.fit(module, data, ckpt_path=start)
    if save is not None:
        training.save_checkpoint(save)
    return module.shown


@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize("workers", [0, 1])
def test_every_epoch_shows_other_pairs(source: PairSource, workers: int) -> None:
    data = PairDataModule(photos=source.photos, shapes=1, batch_size=1, workers=workers)
    assert len(set(shown(data, 4, limit_train_batches=2))) == 4
    assert len(set(shown(data, 4, overfit_batches=2))) == 2, "learnt by heart on purpose"


@pytest.mark.filterwarnings("ignore")
def test_every_written_pair_is_read_in_short_epochs_and_by_a_fit_that_goes_on(
    written: Path, tmp_path: Path
) -> None:
    def data() -> PairDataModule:
        return PairDataModule(written=written, batch_size=2, workers=0)

    through = shown(data(), 8, limit_train_batches=3)
    assert len(set(through)) == 8
    checkpoint = tmp_path / "some.ckpt"
    first = shown(data(), 4, save=checkpoint, limit_train_batches=3)
    assert first + shown(data(), 8, checkpoint, limit_train_batches=3) == through


def trainer(folder: Path, accumulated: int = 1) -> pl.Trainer:
    return pl.Trainer(
        default_root_dir=folder, accelerator="cpu", logger=False, enable_checkpointing=False,
        accumulate_grad_batches=accumulated,
    )  # fmt: skip


def test_a_fit_that_goes_on_skips_batches_and_not_steps(
    written: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(PairDataModule, "_step", lambda _: 3)
    module = PairDataModule(written=written, batch_size=2, workers=0)
    module.trainer = trainer(tmp_path, accumulated=2)
    used = list(islice(WrittenStream(written, 2, 0, 0, 0, 1), 8))
    left = list(islice(module.train_dataloader(), 2))
    for one, other in zip(used[6:], left, strict=True):
        assert torch.equal(one.delta, other.delta)


def test_rollouts_are_of_what_the_fit_itself_exports_unless_told_otherwise(tmp_path: Path) -> None:
    other = tmp_path / "other.safetensors"
    save_network(CorrelationNet(), other)
    for given, used in ((None, tmp_path / "weights.safetensors"), (other, other)):
        module = PairDataModule(shapes=1, workers=0, rollouts=RolloutConfig(given, 2))
        module.trainer = trainer(tmp_path)
        stream = module.train_dataloader().dataset
        assert isinstance(stream, PairStream)
        assert stream.rollouts == RolloutConfig(used, 2)


def test_weights_that_lead_nowhere_are_refused_before_the_first_pair(tmp_path: Path) -> None:
    mistyped = PairDataModule(rollouts=RolloutConfig(tmp_path / "nowhere.safetensors", 2))
    with pytest.raises(InputError, match=r"data\.rollouts\.weights: .*nowhere.* does not exist"):
        mistyped.train_dataloader()
    weights = tmp_path / "weights.safetensors"
    save_network(ActionNet(ActionConfig(channels=(4, 4, 4, 4), hidden=4)), weights)
    with pytest.raises(InputError, match="all six axes"):
        PairDataModule(rollouts=RolloutConfig(weights, 2)).train_dataloader()
    unused = PairDataModule(shapes=1, rollouts=RolloutConfig(tmp_path / "nothing", 0))
    assert isinstance(unused.train_dataloader().dataset, PairStream)


def test_written_pairs_of_other_crops_are_refused(written: Path) -> None:
    module = PairDataModule(written=written, pairs=PairConfig(crop="axis_parallel"))
    with pytest.raises(InputError, match=r"holds pairs with look_at crops.*set it to look_at"):
        module.train_dataloader()


def test_templates_are_not_among_written_pairs(written: Path) -> None:
    module = PairDataModule(written=written, pairs=preset("linear_light"))
    with pytest.raises(InputError, match=r"data\.pairs\.views\.share is 0\.4"):
        module.train_dataloader()


def test_written_pairs_and_rollouts_exclude_each_other(written: Path) -> None:
    module = PairDataModule(written=written, rollouts=RolloutConfig(Path("w"), 2))
    with pytest.raises(InputError, match=r"data\.rollouts\.iterations"):
        module.train_dataloader()


# -- what a fit goes by ----------------------------------------------------------------------------


def test_facts_change_with_the_pairs_and_not_with_who_draws_them(
    source: PairSource, written: Path
) -> None:
    options: dict[str, Any] = {"photos": source.photos, "shapes": 3}
    facts = PairDataModule(**options).facts()
    same = {"workers": 8, "batch_size": 16, "device": "cuda", "validation_batches": 2}
    assert PairDataModule(**options, **same).facts() == facts
    others: dict[str, Any] = {
        "shapes": 4, "seed": 1, "renew_every": 0, "photos": None, "slender": 0.5,
        "written": written, "rollouts": RolloutConfig(None, 2),
        "pairs": PairConfig(crop="axis_parallel"),
    }  # fmt: skip
    for name, value in others.items():
        other = PairDataModule(**{**options, name: value}).facts()
        # Named by both: what a record does not name is taken for the same.
        assert any(facts[key] != other[key] for key in facts.keys() & other.keys()), name
    assert set(PairDataModule(written=written).facts()) == {
        "data.written", "data.dihedral", "data.seed"
    }  # fmt: skip
