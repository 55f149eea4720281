"""Fits a compact network's confidence for searches on where searches and refinements end.

    python -m tools.fit_search_head --meshes MESHES --photos PHOTOS --output WEIGHTS
        [--weights FILE] [--outcomes FOLDER] [--mesh_unit mm] [--holdout 8] [--pictures 80]
        [--jobs 2]

In training the confidence sees starts drawn around true poses, and is asked whether the next pose
is right. A search proposes others, of all that looks most like the object, and wants to know which
loops end right. Synthetic pictures of training meshes (`search_outcomes`) are searched, all
candidates and other starts are refined, and a second head on the same features (`search_head`)
learns from every iteration whether its loop ends below 10 % of the diameter. Nothing else changes.
Prints, cross-validated by picture, the area under the ROC curve of the confidence and of the head.

Half an hour of two cores for 80 pictures. What a picture teaches is kept in the folder of outcomes,
which is one network's and one set of meshes' and photos' (outcomes.json); killed, the same command
goes on. Then `fit_probabilities.py`, whose regression of detections
belongs to the new head.
"""

from __future__ import annotations

import argparse
import copy
import hashlib
import sys
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor, nn
from torch.nn import functional

from moveit6d.errors import InputError
from moveit6d.evaluation.metrics import auroc
from moveit6d.geometry.mesh import Unit
from moveit6d.io import read_json, replacing, write_json
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.weights_file import load_network, save_network
from moveit6d.parallel import run_jobs
from moveit6d.policies import SHIPPED_WEIGHTS
from moveit6d.synthesis.augmentation.photos import photo_files
from tools.search_outcomes import Outcomes, Task, outcomes_of, without_search_head
from tools.training_files import add_options, data_of

MESHES, PHOTOS = 30, 24  # that a picture may take from
EPOCHS, RATE, BATCH = 16, 1e-3, 512
KEEP = 0.001  # weight of the squared distance from the layers as they were
FOLDS = 5
FACTS = "outcomes.json"  # beside the outcomes: what they belong to


def main(arguments: Sequence[str] | None = None) -> int:
    """Make, look, fit, write."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    add_options(parser)
    parser.add_argument("--output", type=Path, required=True, help="weights file to write")
    parser.add_argument("--weights", type=Path, default=SHIPPED_WEIGHTS, help="weights file to fit")
    parser.add_argument("--outcomes", type=Path, default=Path("runs/outcomes"))
    parser.add_argument("--pictures", type=int, default=80)
    parser.add_argument("--jobs", type=int, default=1, help="pictures worked on at a time")
    args = parser.parse_args(arguments)
    loaded = load_network(args.weights)
    network = loaded.network
    if not isinstance(network, CompactCorrelationNet):
        raise InputError(f"{args.weights}: only a compact network has a head for searches.")
    plain = without_search_head(network)
    # Of the meshes never those that are held out.
    meshes, photos = data_of(args).mesh_paths()[0], photo_files(args.photos)
    facts = {
        "network": digest(plain),
        "meshes": digest_of_files(meshes),
        "photos": digest_of_files(photos),
    }
    claim(args.outcomes, facts)
    made = tasks(meshes, photos, args.weights, args.pictures, args.mesh_unit)
    gather(made, args.outcomes, args.jobs)
    known = gathered(args.outcomes, args.pictures)
    report(known, known.before, "confidence")
    report(known, cross_validated(plain.confidence_head, known), "search head")
    head = fitted(plain.confidence_head, known, seed=0)
    save_network(with_search_head(plain, head), args.output, loaded.facts)
    return 0


def with_search_head(network: CompactCorrelationNet, head: nn.Sequential) -> CompactCorrelationNet:
    """The network with that head."""
    whole = CompactCorrelationNet(replace(network.config, search_head=True))
    whole.search_head.load_state_dict(head.state_dict())
    whole.load_state_dict(network.state_dict(), strict=False)
    return whole


def digest(network: CompactCorrelationNet) -> str:
    """SHA-256 of a network's sizes and weights."""
    found = hashlib.sha256(repr(network.config).encode())
    for name, value in sorted(network.state_dict().items()):
        found.update(name.encode())
        found.update(value.contiguous().reshape(-1).view(torch.uint8).numpy().tobytes())
    return found.hexdigest()


def digest_of_files(paths: Sequence[Path]) -> str:
    """SHA-256 of the names and sizes of files."""
    facts = [(path.name, path.stat().st_size) for path in paths]
    return hashlib.sha256(repr(facts).encode()).hexdigest()


def claim(folder: Path, facts: Mapping[str, Any]) -> None:
    """Write beside the outcomes what they belong to.

    `InputError` if there are some that belong to anything else, or nobody knows to what.
    """
    path, remedy = folder / FACTS, "give another folder as --outcomes, or remove them"
    if not any(folder.glob("*.npz")):
        write_json(path, facts)
        return
    if not path.is_file():
        raise InputError(
            f"{folder} holds outcomes, but no {FACTS} says of which network; {remedy}."
        )
    known = read_json(path)
    other = [name for name, value in facts.items() if known.get(name) != value]
    if other:
        raise InputError(f"{folder} holds outcomes with other {', '.join(other)}; {remedy}.")


def tasks(
    paths: Sequence[Path], backgrounds: Sequence[Path], weights: Path, pictures: int,
    unit: Unit,
) -> list[Task]:  # fmt: skip
    """Pictures of meshes in front of photographs."""
    found = []
    for number in range(pictures):
        rng = np.random.default_rng([number, 5])
        some, behind = rng.permutation(len(paths))[:MESHES], rng.permutation(len(backgrounds))
        found.append(
            Task(
                number,
                tuple(paths[k] for k in some),
                tuple(backgrounds[k] for k in behind[:PHOTOS]),
                weights,
                unit,
            )
        )
    return found


def gather(pictures: Sequence[Task], folder: Path, jobs: int) -> None:
    """Write what each picture teaches to the folder, unless it is there."""
    folder.mkdir(parents=True, exist_ok=True)
    left = [task for task in pictures if not _file(folder, task.number).exists()]
    for done in run_jobs(outcomes_of, left, jobs=jobs):
        if done.result is None:
            print(f"picture {left[done.index].number}: {done.error or 'nothing can be seen'}")
            continue
        with replacing(_file(folder, left[done.index].number)) as path:
            done.result.save(path)
        print(f"picture {left[done.index].number}: {len(done.result.right)} iterations", flush=True)


def gathered(folder: Path, pictures: int) -> Outcomes:
    """What so many pictures taught, without those of which there is nothing."""
    paths = [path for number in range(pictures) if (path := _file(folder, number)).exists()]
    if not paths:
        raise InputError(f"{folder}: no picture taught anything; see what is said of each above.")
    return Outcomes.joined([Outcomes.load(path) for path in paths])


def _file(folder: Path, number: int) -> Path:
    return folder / f"{number:05d}.npz"


def fitted(head: nn.Sequential, known: Outcomes, seed: int) -> nn.Sequential:
    """A copy of the layers, fitted to whether loops end right; searches count half of all."""
    generator = torch.Generator().manual_seed(seed)
    new = copy.deepcopy(head).train().requires_grad_(True)
    old = [parameter.detach().clone() for parameter in new.parameters()]
    features = torch.from_numpy(known.features).float()
    right = torch.from_numpy(known.right).float()
    weight = balanced(known.searched)
    optimizer = torch.optim.Adam(new.parameters(), lr=RATE)
    batches = max(1, len(right) // BATCH)
    schedule = torch.optim.lr_scheduler.LinearLR(optimizer, 1.0, 0.0, EPOCHS * batches)
    for _ in range(EPOCHS):
        order = torch.randperm(len(right), generator=generator)
        for rows in order.chunk(batches):
            losses = functional.binary_cross_entropy_with_logits(
                new(features[rows].clone())[:, 0], right[rows], reduction="none"
            )
            moved = sum(
                ((now - then) ** 2).sum() for now, then in zip(new.parameters(), old, strict=True)
            )
            loss = (losses * weight[rows]).mean() + KEEP * moved
            optimizer.zero_grad()
            loss.backward()  # type: ignore[no-untyped-call]
            optimizer.step()
            schedule.step()
    return new.eval().requires_grad_(False)


def balanced(searched: NDArray[np.bool_]) -> Tensor:
    """Weights (N,) of mean 1 with which the two kinds count the same."""
    share = searched.mean()
    if share in (0.0, 1.0):
        return torch.ones(len(searched))
    return torch.from_numpy(np.where(searched, 0.5 / share, 0.5 / (1 - share))).float()


def cross_validated(head: nn.Sequential, known: Outcomes) -> NDArray[np.float32]:
    """The confidence (N,) from layers that were fitted to other pictures."""
    found = np.zeros(len(known.right), np.float32)
    for fold in range(FOLDS):
        apart = known.picture % FOLDS == fold
        new = fitted(head, known.part(~apart), seed=fold)
        with torch.inference_mode():
            logits = new(torch.from_numpy(known.features[apart]).float())[:, 0]
        found[apart] = torch.sigmoid(logits).numpy()
    return found


def report(known: Outcomes, confidence: NDArray[np.float32], name: str) -> None:
    """Print how well the confidence tells loops that end right."""
    for kind, rows in (
        ("searches, every iteration", known.searched),
        ("searches, last iteration", known.searched & known.last),
        ("other starts, every iteration", ~known.searched),
        ("other starts, last iteration", ~known.searched & known.last),
    ):
        chosen = confidence[rows], known.right[rows]
        area = auroc(*(torch.from_numpy(part) for part in chosen))
        print(
            f"{name}: {kind}: {rows.sum()}, {known.right[rows].mean():.0%} right, mean confidence "
            f"{confidence[rows].mean():.2f}, AUROC {area:.3f}"
        )


if __name__ == "__main__":
    try:
        sys.exit(main())
    except InputError as error:
        sys.exit(f"fit_search_head: {error}")
