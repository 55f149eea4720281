"""Sequences in other processes: a killed one is done again, and the tracks are the same."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import torch

from moveit6d.cli.main import main
from moveit6d.datasets.pose_files import read_poses
from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
from moveit6d.networks.weights_file import save_network

Make = Callable[..., Any]


TINY = CorrelationConfig(channels=(4, 6, 8), geometry=(4, 4, 4), context=8, decoder=8, fine=8)


def test_two_processes_with_one_killed_give_the_same_tracks(
    make_sequence: Make, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from moveit6d.cli import sequence_job
    from tests.support import killed_sequence

    for name in ("easy_00", "easy_01", "hard_00"):
        made = make_sequence(name, frames=3)
    weights = tmp_path / "weights.safetensors"
    torch.manual_seed(0)
    save_network(CorrelationNet(TINY), weights)
    command = [
        "benchmark",
        "tracking",
        "--sequences",
        str(made.folder.parent),
        "--weights",
        str(weights),
        "--no_recovery",  # the object is lost: of such weights every pose is wrong
        "--max_iterations",
        "2",
        "--output",
    ]
    assert main([*command, str(tmp_path / "one")]) == 0
    monkeypatch.setattr(sequence_job, "work", killed_sequence.work)
    monkeypatch.setenv(killed_sequence.FOLDER, str(tmp_path))
    assert main([*command, str(tmp_path / "two"), "--jobs", "2"]) == 0
    assert (tmp_path / "killed").exists()
    for name in ("easy_00", "easy_01", "hard_00"):
        one, two = (read_poses(tmp_path / place / f"{name}.csv") for place in ("one", "two"))
        assert [replace(row, milliseconds=None, pose=None) for row in one] == [
            replace(row, milliseconds=None, pose=None) for row in two
        ]
        for mine, theirs in zip(one, two, strict=True):
            assert mine.pose is not None and theirs.pose is not None
            assert torch.equal(mine.pose.rotation, theirs.pose.rotation)
            assert torch.equal(mine.pose.translation, theirs.pose.translation)
    assert not list((tmp_path / "two").glob(".*")), "a killed worker leaves nothing behind"
