"""Mesh files of data sets: what is written is read back, at the same place in the same colours."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from moveit6d.datasets.mesh_writers import is_plain, write_obj, write_ply
from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from tests.support.meshes import colored_box, sphere, textured_box

WRITERS = {"ply": write_ply, "obj": write_obj}


@pytest.fixture(params=["ply", "obj"])
def write(request: pytest.FixtureRequest) -> tuple[str, Callable[..., None]]:
    return request.param, WRITERS[request.param]


def seen(mesh: Mesh) -> np.ndarray:
    """Corners of faces in the file's frame with their texture coordinates or colours, sorted."""
    look = mesh.uv if mesh.uv is not None else mesh.vertex_colors
    assert look is not None
    rows = np.concatenate([mesh.vertices + mesh.center, look], 1)[mesh.faces.reshape(-1)]
    return rows[np.lexsort(np.round(rows, 4).T)]


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_colours_come_back(tmp_path: Path, write: tuple[str, Callable], unit: str) -> None:
    mesh = colored_box(offset=(0.02, 0.01, -0.03))
    path = tmp_path / f"box.{write[0]}"
    write[1](path, mesh, unit)
    np.testing.assert_allclose(seen(Mesh.load(path, unit)), seen(mesh), atol=1e-6)  # type: ignore


@pytest.mark.parametrize("name", ["box", "d\u00f6se \u7bb1"])
def test_a_texture_comes_back_upright(
    tmp_path: Path, write: tuple[str, Callable], name: str
) -> None:
    texture = np.random.default_rng(0).integers(0, 256, (16, 24, 3), np.uint8)
    mesh = textured_box(texture)
    path = tmp_path / "models" / f"{name}.{write[0]}"
    write[1](path, mesh)
    back = Mesh.load(path)
    assert back.texture is not None
    np.testing.assert_array_equal(back.texture, texture)
    np.testing.assert_allclose(seen(back), seen(mesh), atol=1e-5)


def test_ply_names_only_types_that_bop_knows(tmp_path: Path) -> None:
    write_ply(tmp_path / "box.ply", colored_box())
    head = (tmp_path / "box.ply").read_bytes().split(b"end_header")[0].decode()
    kinds = {line.split()[1] for line in head.splitlines() if line.startswith("property")}
    assert kinds == {"float", "uchar", "list"}
    assert "property list uchar int vertex_indices" in head


def test_a_plain_mesh_comes_back_plain(tmp_path: Path, write: tuple[str, Callable]) -> None:
    mesh = sphere(subdivisions=2)
    write[1](tmp_path / f"ball.{write[0]}", mesh)
    back = Mesh.load(tmp_path / f"ball.{write[0]}")  # refuses a file that names a flat colour
    np.testing.assert_allclose(seen(back), seen(mesh), atol=1e-7)
    assert is_plain(back) and is_plain(mesh) and not is_plain(colored_box())


def test_one_flat_colour_is_kept(tmp_path: Path, write: tuple[str, Callable]) -> None:
    red = np.full((24, 3), (200, 10, 20), np.uint8)
    mesh = replace(colored_box(), vertex_colors=red)
    write[1](tmp_path / f"box.{write[0]}", mesh)
    back = Mesh.load(tmp_path / f"box.{write[0]}", allow_flat=True)
    assert back.vertex_colors is not None and back.vertex_colors[0].tolist() == [200, 10, 20]


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_a_shape_far_away_is_kept(tmp_path: Path, write: tuple[str, Callable], unit: str) -> None:
    mesh = colored_box((0.1234567, 0.0654321, 0.0456789), offset=(4e5, 5e6, 100))
    write[1](tmp_path / f"box.{write[0]}", mesh, unit)
    back = Mesh.load(tmp_path / f"box.{write[0]}", unit)  # type: ignore
    assert back.diameter == pytest.approx(mesh.diameter, rel=1e-6)
    np.testing.assert_allclose(back.center, mesh.center, rtol=0, atol=1e-8)


def test_ply_far_away_names_double(tmp_path: Path) -> None:
    write_ply(tmp_path / "box.ply", colored_box(offset=(0, 100, 0)))
    head = (tmp_path / "box.ply").read_bytes().split(b"end_header")[0].decode()
    assert "property double y" in head and "property float nx" in head


def test_a_ply_that_cannot_be_written_leaves_no_texture(tmp_path: Path) -> None:
    (tmp_path / "box.ply").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        write_ply(tmp_path / "box.ply", textured_box(np.zeros((4, 4, 3), np.uint8)))
    (tmp_path / "can_texture.png").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        write_ply(tmp_path / "can.ply", textured_box(np.zeros((4, 4, 3), np.uint8)))
    assert {one.name for one in tmp_path.iterdir()} == {"box.ply", "can_texture.png"}
