"""Layers that are fitted to outcomes tell right from wrong; pictures that are known stay."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from moveit6d.errors import InputError
from moveit6d.evaluation.metrics import auroc
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.weights_file import load_network
from moveit6d.policies import SHIPPED_WEIGHTS
from tools import fit_search_head
from tools.search_outcomes import Outcomes, Task, without_search_head


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


def test_only_the_pictures_that_are_asked_for_count(tmp_path: Path) -> None:
    for number in (0, 2, 7):
        outcomes(6, picture=number).save(tmp_path / f"{number:05d}.npz")
    (tmp_path / ".00001.4711.npz").write_bytes(b"of a process that was killed")
    assert set(fit_search_head.gathered(tmp_path, 5).picture.tolist()) == {0, 2}
    with pytest.raises(InputError, match="no picture taught anything"):
        fit_search_head.gathered(tmp_path / "none", 5)


def test_outcomes_of_another_network_or_of_an_unknown_one_are_refused(tmp_path: Path) -> None:
    facts = {"network": "a", "meshes": 3, "photos": 2}
    fit_search_head.claim(tmp_path / "new", {**facts, "network": "before"})
    fit_search_head.claim(tmp_path / "new", facts)  # nothing was made: it may be another's
    outcomes(6, picture=0).save(tmp_path / "new" / "00000.npz")
    fit_search_head.claim(tmp_path / "new", facts)
    for name, value in (("network", "b"), ("meshes", 4)):
        with pytest.raises(InputError, match=f"new holds outcomes with other {name}; give another"):
            fit_search_head.claim(tmp_path / "new", {**facts, name: value})
    (tmp_path / "new" / fit_search_head.FACTS).unlink()
    with pytest.raises(InputError, match=r"no outcomes\.json says of which network; give another"):
        fit_search_head.claim(tmp_path / "new", facts)


def test_a_network_is_known_by_what_makes_the_outcomes() -> None:
    network = load_network(SHIPPED_WEIGHTS).network
    assert isinstance(network, CompactCorrelationNet)
    plain = without_search_head(network)
    known = fit_search_head.digest(plain)
    other = fit_search_head.with_search_head(plain, plain.confidence_head)
    assert fit_search_head.digest(without_search_head(other)) == known
    with torch.no_grad():
        next(plain.parameters()).flatten()[0] += 1e-3
    assert fit_search_head.digest(plain) != known


def test_other_files_are_other_outcomes(tmp_path: Path) -> None:
    paths = [tmp_path / name for name in ("a.glb", "b.glb")]
    for path in paths:
        path.write_bytes(b"12")
    digest_of_files = fit_search_head.digest_of_files
    known = digest_of_files(paths)
    assert known == digest_of_files(list(paths)) != digest_of_files(paths[:1])
    paths[1].write_bytes(b"123")
    assert known != digest_of_files(paths)
