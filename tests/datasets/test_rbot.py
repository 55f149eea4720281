"""RBOT: millimetres, one motion for all, and half a pixel."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.datasets.rbot import read_rbot, write_rbot
from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.symmetry import Symmetries
from tests.support.sequence_meshes import AXIS


@pytest.fixture
def root(tmp_path: Path, scene: Any, brick: Mesh) -> Path:
    """Two objects, one of them in two variants."""
    for name, variant in (("cat", "a_regular"), ("cat", "c_noisy"), ("duck", "a_regular")):
        frames = ((scene.image(k), scene.pose(k)) for k in range(3))
        write_rbot(tmp_path, name, brick, scene.camera, frames, variant)
    return tmp_path


def test_what_is_written_is_read(root: Path, scene: Any, brick: Mesh) -> None:
    found = read_rbot(root)
    assert [one.name for one in found] == ["cat.a_regular", "cat.c_noisy", "duck.a_regular"]
    one = found[1]
    assert (one.level, one.object, one.mesh_unit) == ("c_noisy", "cat", "mm")
    for frame in range(3):
        assert (one.truth[frame].matrix - scene.pose(frame).matrix).abs().max() < 1e-8
    assert not one.symmetric
    assert one.load_mesh().diameter == pytest.approx(brick.diameter, rel=1e-5)
    np.testing.assert_array_equal([f.image for f in one.open()][2], scene.image(2))
    assert one.camera.cx == pytest.approx(scene.camera.cx)


def test_the_published_principal_point_counts_from_the_corner(root: Path) -> None:
    (root / "camera_calibration.txt").write_text("fx fy cx cy\n650.048 647.183 324.328 257.323\n")
    camera = read_rbot(root)[0].camera
    assert (camera.fx, camera.fy) == (650.048, 647.183)
    assert (camera.cx, camera.cy) == pytest.approx((323.828, 256.823))


def test_what_is_missing_is_said(root: Path, tmp_path_factory: Any) -> None:
    with pytest.raises(InputError, match=r"holds no RBOT data: looked for poses_first\.txt"):
        read_rbot(tmp_path_factory.mktemp("empty"))
    (root / "cat" / "cat.obj").unlink()
    with pytest.raises(InputError, match=r"its mesh is missing; looked for cat\.obj"):
        read_rbot(root)
    (root / "poses_first.txt").write_text("head\n1 2 3\n")
    with pytest.raises(InputError, match=r"poses_first\.txt: 12 finite numbers a line expected"):
        read_rbot(root)
    (root / "poses_first.txt").write_text("head\n1 2 x\n")
    with pytest.raises(InputError, match="cannot be read below its header line"):
        read_rbot(root)


def test_declared_symmetries_are_kept(tmp_path: Path, scene: Any, brick: Mesh) -> None:
    can = replace(brick, symmetries=Symmetries.from_bop(AXIS))
    frames = ((scene.image(k), scene.pose(k)) for k in range(2))
    write_rbot(tmp_path, "can", can, scene.camera, frames)
    (found,) = read_rbot(tmp_path)
    assert found.symmetric
    (axis,) = found.load_mesh().symmetries.continuous
    np.testing.assert_allclose(axis.offset, [0.03, -0.01, 0.02], atol=1e-12)
