"""Symmetries declared beside a mesh file."""

import json
from pathlib import Path

import numpy as np
import pytest

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.symmetry import Symmetries
from moveit6d.geometry.symmetry_file import symmetries_beside, write_symmetries

AXIS = {"symmetries_continuous": [{"axis": [0, 0, 1], "offset": [10, 0, 0]}]}


def test_nothing_beside_means_no_symmetry(tmp_path: Path) -> None:
    assert symmetries_beside(tmp_path / "can.glb").is_trivial


def test_a_file_of_the_mesh_s_name_in_bop_s_keys_and_millimetres(tmp_path: Path) -> None:
    (tmp_path / "can.symmetry.json").write_text(json.dumps(AXIS))
    (found,) = symmetries_beside(tmp_path / "can.glb").continuous
    assert np.allclose(found.axis, (0, 0, 1)) and np.allclose(found.offset, (0.01, 0, 0))
    assert symmetries_beside(tmp_path / "cup.glb").is_trivial


def test_bop_s_models_info_beside_its_models(tmp_path: Path) -> None:
    half = [-1, 0, 0, 0, 0, -1, 0, 0, 0, 0, 1, 5, 0, 0, 0, 1]
    info = {"5": {"diameter": 100, "symmetries_discrete": [half]}, "6": {"diameter": 80}}
    (tmp_path / "models_info.json").write_text(json.dumps(info))
    found = symmetries_beside(tmp_path / "obj_000005.ply").discrete
    assert np.allclose(
        found[0],
        np.array(half).reshape(4, 4) * [[1], [1], [0.001], [1]] + np.diag([0, 0, 0.999, 0]),
    )
    assert symmetries_beside(tmp_path / "obj_000006.ply").is_trivial
    assert symmetries_beside(tmp_path / "obj_000007.ply").is_trivial


def test_a_mesh_that_is_loaded_has_what_is_declared(brick_file: Path, tmp_path: Path) -> None:
    path = tmp_path / "brick.ply"
    path.write_bytes(brick_file.read_bytes())
    path.with_name("brick.symmetry.json").write_text(json.dumps(AXIS))
    assert len(Mesh.load(path, "m").symmetries.continuous) == 1


@pytest.mark.parametrize("text", ["{}", "[]", "{", '{"symmetries": []}'])
def test_files_that_declare_nothing_are_refused(tmp_path: Path, text: str) -> None:
    (tmp_path / "can.symmetry.json").write_text(text)
    with pytest.raises(InputError, match=r"can\.symmetry\.json"):
        symmetries_beside(tmp_path / "can.glb")


@pytest.mark.parametrize("key", ["symmetries_discretes", "Symmetries_Continuous", "symmetry"])
def test_a_misspelt_key_is_not_dropped(tmp_path: Path, key: str) -> None:
    (tmp_path / "can.symmetry.json").write_text(json.dumps({**AXIS, key: []}))
    with pytest.raises(InputError, match=rf"can\.symmetry\.json: there is no key '{key}'; did you"):
        symmetries_beside(tmp_path / "can.glb")
    (tmp_path / "models_info.json").write_text(json.dumps({"5": {"diameter": 100, key: []}}))
    with pytest.raises(InputError, match=rf"models_info\.json: there is no key '{key}'; did you"):
        symmetries_beside(tmp_path / "obj_000005.ply")


def test_the_quarter_turn_alone_declares_four_motions(tmp_path: Path) -> None:
    turn = [0, -1, 0, 0, 1, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    (tmp_path / "can.symmetry.json").write_text(json.dumps({"symmetries_discrete": [turn]}))
    found = symmetries_beside(tmp_path / "can.glb").transforms()
    turns = np.degrees(np.arctan2(found[:, 1, 0], found[:, 0, 0])) % 360
    np.testing.assert_allclose(turns, [0, 90, 180, 270], atol=1e-9)


def test_what_is_written_is_read_and_nothing_declared_is_no_file(tmp_path: Path) -> None:
    half = [-1, 0, 0, 20, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    declared = Symmetries.from_bop({**AXIS, "symmetries_discrete": [half]})
    write_symmetries(tmp_path / "can.glb", declared)
    found = symmetries_beside(tmp_path / "can.glb")
    np.testing.assert_allclose(found.transforms(90), declared.transforms(90), atol=1e-12)
    write_symmetries(tmp_path / "can.glb", Symmetries())
    assert not list(tmp_path.iterdir()), "an older declaration would be of another mesh"
