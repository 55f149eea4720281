"""Meshes of other sizes: spread as asked for, and what a tracker that sees the size makes of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d import load_policy
from moveit6d.config import CalibrationConfig, TrackerConfig
from moveit6d.datasets import open_dataset
from moveit6d.geometry.mesh import Mesh
from moveit6d.synthesis.sequences.sequence import write_sequence
from tools.mesh_sizes import errors_of, sizes


def test_sizes_are_spread_as_asked_for() -> None:
    found = sizes(40, 0.02)
    assert found.mean() == pytest.approx(1) and found.std() == pytest.approx(0.02, rel=0.1)
    assert np.array_equal(found, sizes(40, 0.02)) and (sizes(3, 0.0) == 1).all()


def test_an_object_is_followed_by_a_mesh_that_is_too_small(brick: Mesh, tmp_path: Path) -> None:
    write_sequence(tmp_path / "easy_00", mesh=brick, seed=3, frames=4, difficulty="easy")
    (sequence,) = open_dataset(tmp_path, None)
    off = TrackerConfig(calibration=CalibrationConfig(enabled=False))
    found, sizes_seen = {}, {}
    for name, config in (("without", off), ("with", TrackerConfig())):
        found[name], sizes_seen[name] = errors_of(sequence, 0.96, load_policy(), config)
    assert sizes_seen["without"] == 1 and sizes_seen["with"] == pytest.approx(1.03, abs=0.015)
    assert found["with"].max() < found["without"].min() / 2
