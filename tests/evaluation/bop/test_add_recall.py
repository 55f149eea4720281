"""Scores of BOP result files: known answers on a made-up set, and the published share on LM-O."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from moveit6d.datasets.bop import BopDataset, Estimate, Instance, read_results
from moveit6d.errors import InputError
from moveit6d.evaluation.bop.add_recall import results_table, score_results, targets_of
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3


class MadeUp(BopDataset):
    """Object 1 without, object 2 with a symmetry, both the brick; nothing on disk."""

    def __init__(self, brick: Mesh, truth: Mapping[tuple[int, int], list[Instance]]) -> None:
        self.brick, self.known = brick, truth

    def mesh(self, number: int) -> Mesh:
        return self.brick

    def truth(self, scene: int, image: int) -> list[Instance]:
        return self.known[scene, image]

    def diameter(self, number: int) -> float:
        return 0.1

    def is_symmetric(self, number: int) -> bool:
        return number == 2


def at(x: float) -> Pose:
    return Pose(torch.eye(3, dtype=torch.float64), torch.tensor([x, 0.0, 1.0], dtype=torch.float64))


@pytest.fixture
def dataset(brick: Mesh) -> MadeUp:
    instances = [Instance(1, at(0)), Instance(2, at(0.2)), Instance(1, at(0.4))]
    return MadeUp(brick, {(7, 1): instances, (7, 2): [Instance(1, at(0))]})


def test_known_errors_in_diameters(dataset: MadeUp, brick: Mesh) -> None:
    centre = torch.from_numpy(brick.center)
    half = Pose(exp_so3(torch.tensor([0.0, 0.0, math.pi], dtype=torch.float64)), torch.zeros(3))
    about_centre = Pose(half.rotation, centre - half.rotation @ centre)
    rows = [
        Estimate(7, 2, 1, 0.2, at(0.004)),
        Estimate(7, 1, 2, 0.9, at(0.2) @ about_centre),  # half a turn of the symmetric brick
        Estimate(7, 1, 1, 0.5, at(0.45)),  # nearest to the second instance
        Estimate(7, 2, 1, 0.1, at(0)),  # a lower score: not the estimate that counts
    ]
    targets = targets_of(rows, dataset)
    assert targets == [(7, 2, 1), (7, 1, 2), (7, 1, 1)]
    found = score_results(dataset, rows, targets)
    # The first instance of object 1 in image 1 has no estimate of its own.
    assert found.errors.tolist() == pytest.approx([0.04, 0, math.inf, 0.5], abs=1e-6)
    assert found.objects.tolist() == [1, 2, 1, 1]
    assert found.scores.tolist() == [0.2, 0.9, 0, 0.5]
    assert found.below(0.1) == 0.5 and found.below(0.1, 1) == pytest.approx(1 / 3)
    assert found.median == pytest.approx(0.27)


def test_a_missing_target_is_wrong(dataset: MadeUp) -> None:
    rows = [Estimate(7, 1, 1, 1.0, at(0)), Estimate(7, 2, 1, 1.0, at(0))]
    targets = targets_of(rows, dataset)
    found = score_results(dataset, rows[:1], targets)
    assert found.errors.tolist() == [0, math.inf, math.inf]
    assert found.scores.tolist() == [1.0, 0.0, 0.0]
    assert found.below(0.1) == pytest.approx(1 / 3)


def test_every_instance_is_a_target_and_is_found_once(dataset: MadeUp) -> None:
    both = [Estimate(7, 1, 1, 0.9, at(0)), Estimate(7, 1, 1, 0.8, at(0.4))]
    targets = targets_of(both, dataset)
    assert score_results(dataset, both, targets).below(0.1) == 1
    assert score_results(dataset, both[:1], targets).below(0.1) == 0.5
    twice = [both[0], replace(both[0], score=0.7)]
    assert score_results(dataset, twice, targets).below(0.1) == 0.5
    # A third estimate, even a right one, is beyond the two that count.
    late = [both[0], replace(both[0], score=0.7), replace(both[1], score=0.1)]
    assert score_results(dataset, late, targets).below(0.1) == 0.5


def test_results_for_other_objects_are_refused(dataset: MadeUp) -> None:
    with pytest.raises(InputError, match="none of the estimates"):
        targets_of([Estimate(7, 1, 5, 1.0, at(0))], dataset)


def test_the_table_has_a_row_a_file_and_a_column_an_object(dataset: MadeUp) -> None:
    rows = [Estimate(7, 1, 2, 1.0, at(0.2)), Estimate(7, 2, 1, 1.0, at(0.03))]
    after = [rows[0], replace(rows[1], pose=at(0.001))]
    targets = targets_of(rows, dataset)
    table = results_table(
        [(name, score_results(dataset, r, targets)) for name, r in (("a", rows), ("b", after))]
    )
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in table.splitlines()]
    assert cells[0][-2:] == ["obj 1", "obj 2"]
    assert cells[2][:3] == ["a", "2", "50.0 %"] and cells[2][-2:] == ["0.0 %", "100.0 %"]
    assert cells[3][:3] == ["b", "2", "100.0 %"]


def test_linemod_gives_the_published_shares(shared: Path) -> None:
    dataset = BopDataset(shared / "data" / "real" / "lmo_dev", "test")
    rows = [
        row for row in read_results(dataset.root / "initial_small.csv") if row.object in (5, 10)
    ]
    found: Any = score_results(dataset, rows, targets_of(rows, dataset))
    # data/real/README.md: 34.3 and 80.9 percent.
    assert round(100 * found.below(0.1, 5), 1) == 34.3
    assert round(100 * found.below(0.1, 10), 1) == 80.9
