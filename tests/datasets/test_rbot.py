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
from tests.support.meshes import colored_box
from tests.support.sequence_meshes import AXIS, assert_has_axis


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
    assert_has_axis(found.load_mesh())


def test_a_gap_is_a_frame_with_an_error_and_moves_no_pose(root: Path, scene: Any) -> None:
    for number in (0, 1):
        (root / "cat" / "frames" / f"a_regular{number:04d}.png").unlink()
    one = read_rbot(root)[0]
    assert one.name == "cat.a_regular" and one.camera.width == scene.camera.width
    frames = list(one.open())
    assert [frame.error is None for frame in frames] == [False, False, True]
    np.testing.assert_array_equal(frames[2].image, scene.image(2))
    assert (one.truth[2].matrix - scene.pose(2).matrix).abs().max() < 1e-8


def test_another_motion_is_refused_and_leaves_nothing(root: Path, scene: Any, brick: Mesh) -> None:
    before = (root / "poses_first.txt").read_bytes()
    frames = ((scene.image(k), scene.pose(k + (k == 2))) for k in range(3))
    with pytest.raises(InputError, match=r"poses_first\.txt .*holds another pose of frame 2"):
        write_rbot(root, "egg", brick, scene.camera, frames)
    assert (root / "poses_first.txt").read_bytes() == before
    assert not list(root.glob("egg/**/*.png"))
    assert len(read_rbot(root)) == 3


def test_the_longest_sequence_gives_the_poses(root: Path, scene: Any, brick: Mesh) -> None:
    for name, count in (("egg", 2), ("iron", 5)):
        frames = ((scene.image(k), scene.pose(k)) for k in range(count))
        write_rbot(root, name, brick, scene.camera, frames)
        lengths = {one.name: len(one.truth) for one in read_rbot(root)}
        assert lengths["cat.a_regular"] == 3 and lengths[f"{name}.a_regular"] == count


def test_a_sequence_alone_is_replaced_whole(tmp_path: Path, scene: Any, brick: Mesh) -> None:
    for start, count in ((0, 4), (0, 4), (7, 2)):
        frames = ((scene.image(k), scene.pose(start + k)) for k in range(count))
        write_rbot(tmp_path, "cat", brick, scene.camera, frames)
    (one,) = read_rbot(tmp_path)
    assert (one.truth[1].matrix - scene.pose(8).matrix).abs().max() < 1e-8
    assert len(list(one.frames.iterdir())) == 2
    assert [place.name for place in sorted(tmp_path.glob("cat/*"))] == ["cat.obj", "frames"]


def test_what_the_format_cannot_hold_is_refused(root: Path, scene: Any, brick: Mesh) -> None:
    def write(name: str, mesh: Mesh = brick, **changes: Any) -> None:
        camera = replace(scene.camera, **changes)
        write_rbot(root, name, mesh, camera, [(scene.image(0), scene.pose(0))], "d_occlusion")

    with pytest.raises(InputError, match="no lens distortion, and the camera has opencv"):
        write("egg", distortion=(0.1, 0, 0, 0))
    with pytest.raises(InputError, match="no skew, and the camera has one of 2"):
        write("egg", skew=2)
    assert not (root / "egg").exists()
    with pytest.raises(InputError, match=r"camera_calibration\.txt .* another camera"):
        write("egg", fx=scene.camera.fx + 1)
    with pytest.raises(InputError, match=r"cat\.obj is there and holds another mesh"):
        write("cat", colored_box())
    write("cat", distortion=(0.0, 0, 0, 0))
    assert len(read_rbot(root)) == 4
