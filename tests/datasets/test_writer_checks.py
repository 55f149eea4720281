"""What is shared is kept if it is the same, however it was written, and else refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.datasets.mesh_writers import write_obj, write_ply
from moveit6d.datasets.writer_checks import check_no_lens, check_no_skew, write_shared_mesh
from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.symmetry import Symmetries
from tests.support.meshes import colored_box, sphere, textured_box

PINHOLE = Camera(600, 600, 320, 240, 640, 480)
PICTURE = np.random.default_rng(0).integers(0, 256, (16, 24, 3), np.uint8)
MESHES = {"colours": colored_box(), "texture": textured_box(PICTURE), "plain": sphere()}
QUARTER = {"symmetries_discrete": [[0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]]}


@pytest.mark.parametrize("mesh", MESHES.values(), ids=MESHES)
@pytest.mark.parametrize("suffix", ["ply", "obj"])
def test_the_same_mesh_stays(tmp_path: Path, mesh: Mesh, suffix: str) -> None:
    path, write = tmp_path / f"it.{suffix}", {"ply": write_ply, "obj": write_obj}[suffix]
    mesh = replace(mesh, symmetries=Symmetries.from_bop(QUARTER))
    write_shared_mesh(path, mesh, write, "mm")
    path.touch()
    before = path.stat().st_mtime_ns
    write_shared_mesh(path, mesh, write, "mm")
    write_shared_mesh(path, Mesh.load(path, "mm"), write, "mm")  # its declaration is closed now
    assert path.stat().st_mtime_ns == before


CHANGES = {
    "colour": {"vertex_colors": np.roll(colored_box().vertex_colors, 1)},  # type: ignore
    "place": {"center": np.array([0, 0, 1e-4])},
    "shape": {"vertices": np.float32(1.001) * colored_box().vertices},
    "faces": {"faces": colored_box().faces[:-1]},
    "symmetries": {"symmetries": Symmetries.from_bop(QUARTER)},
}


@pytest.mark.parametrize("changes", CHANGES.values(), ids=CHANGES)
def test_any_other_mesh_is_refused(tmp_path: Path, changes: dict[str, Any]) -> None:
    path = tmp_path / "box.ply"
    write_shared_mesh(path, colored_box(), write_ply)
    before = path.read_bytes()
    with pytest.raises(InputError, match=r"box\.ply is there and holds a(nother mesh| mesh with)"):
        write_shared_mesh(path, replace(colored_box(), **changes), write_ply)
    assert path.read_bytes() == before and list(tmp_path.iterdir()) == [path]


def test_another_texture_is_refused(tmp_path: Path) -> None:
    write_shared_mesh(tmp_path / "box.obj", textured_box(PICTURE), write_obj)
    with pytest.raises(InputError, match="holds another mesh"):
        write_shared_mesh(tmp_path / "box.obj", textured_box(PICTURE[::-1]), write_obj)


def test_cameras_that_do_not_fit_are_refused() -> None:
    check_no_lens(replace(PINHOLE, distortion=(0.0,) * 5, skew=1), "it")
    check_no_skew(replace(PINHOLE, distortion=(0.1,) * 5), "it")
    for lens in ({"distortion": (0.1, 0, 0, 0)}, {"distortion": (0.0,) * 4} | {
        "distortion_model": "fisheye"}):  # fmt: skip
        with pytest.raises(InputError, match=r"^here holds no lens distortion, .* undistort"):
            check_no_lens(replace(PINHOLE, **lens), "here")  # type: ignore
    with pytest.raises(InputError, match=r"^here holds no skew, and the camera has one of -1\.5"):
        check_no_skew(replace(PINHOLE, skew=-1.5), "here")
