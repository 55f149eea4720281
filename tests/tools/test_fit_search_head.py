"""Layers that are fitted to outcomes tell right from wrong; pictures that are known stay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from moveit6d.evaluation.metrics import auroc
from tools import fit_search_head
from tools.search_outcomes import Outcomes, Task


def outcomes(count: int, seed: int = 0, picture: int | None = None) -> Outcomes:
    """Loops that end right where the first of five features is high."""
    random = np.random.default_rng(seed)
    features = random.normal(size=(count, 5)).astype(np.float16)
    right = features[:, 0] + 0.3 * random.normal(size=count) > 0
    numbers = np.arange(count) % 10 if picture is None else np.full(count, picture)
    searched = random.random(count) < 0.25
    return Outcomes(
        features, np.full(count, 0.5, np.float32), right, searched, random.random(count) < 0.5,
        numbers,
    )  # fmt: skip


def layers() -> nn.Sequential:
    torch.manual_seed(0)
    return nn.Sequential(nn.Linear(5, 8), nn.ReLU(inplace=True), nn.Linear(8, 1))


def test_fitted_layers_tell_loops_of_other_pictures(capsys: pytest.CaptureFixture[str]) -> None:
    known, head = outcomes(40000), layers()
    before = [parameter.clone() for parameter in head.parameters()]
    said = fit_search_head.cross_validated(head, known)
    area = auroc(torch.from_numpy(said), torch.from_numpy(known.right))
    assert area > 0.95
    assert abs(said.mean() - known.right.mean()) < 0.05
    for then, now in zip(before, head.parameters(), strict=True):
        torch.testing.assert_close(then, now)
    fit_search_head.report(known, said, "after")
    assert "searches, last iteration" in capsys.readouterr().out


def test_both_kinds_count_the_same() -> None:
    searched = np.array([True] * 30 + [False] * 10)
    weight = fit_search_head.balanced(searched).numpy()
    assert weight.mean() == pytest.approx(1)
    assert weight[searched].sum() == pytest.approx(weight[~searched].sum())
    assert fit_search_head.balanced(np.array([True, True])).tolist() == [1, 1]


def test_a_picture_that_is_known_is_not_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[int] = []

    def fake(task: Task) -> Any:
        made.append(task.number)
        return None if task.number == 2 else outcomes(6, picture=task.number)

    monkeypatch.setattr(fit_search_head, "outcomes_of", fake)
    tasks = [Task(number, (), (), Path("weights")) for number in range(3)]
    fit_search_head.gather(tasks[:1], tmp_path, 1)
    fit_search_head.gather(tasks, tmp_path, 1)
    assert made == [0, 1, 2]
    files = sorted(tmp_path.glob("*.npz"))
    assert [path.stem for path in files] == ["00000", "00001"]
    assert set(Outcomes.load(files[1]).picture.tolist()) == {1}
