"""A pack for a lent GPU: what meshes need goes along, and no other folder is replaced."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
import trimesh
from PIL import Image

from moveit6d.datasets.mesh_writers import write_obj
from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.symmetry import Symmetries
from moveit6d.geometry.symmetry_file import write_symmetries
from moveit6d.rendering.cuda_renderer import BankRenderer
from tests.support.meshes import textured_box
from tests.support.pairs import photos
from tests.support.rasterizer import compiled
from tools import pack_for_gpu, probe_gpu
from tools.pack_for_gpu import main


@pytest.fixture
def given(tmp_path: Path) -> list[str]:
    """A folder with a mesh of several files and a folder with a photograph."""
    for name in ("meshes", "photos"):
        (tmp_path / name).mkdir()
    picture = np.random.default_rng(0).integers(0, 256, (8, 8, 3), np.uint8)
    write_obj(tmp_path / "meshes" / "can.obj", textured_box(picture))
    axis = {"symmetries_continuous": [{"axis": [0, 0, 1]}]}
    write_symmetries(tmp_path / "meshes" / "can.obj", Symmetries.from_bop(axis))
    Image.fromarray(photos()[0]).save(tmp_path / "photos" / "0.png")
    return [str(tmp_path / "meshes"), str(tmp_path / "photos")]


def test_materials_pictures_and_symmetries_go_along_and_an_older_pack_is_replaced(
    given: list[str], tmp_path: Path
) -> None:
    pack = tmp_path / "pack"
    for _ in range(2):
        assert main([*given, str(pack)]) == 0
        mesh = Mesh.load(pack / "meshes" / "can.obj")
        assert mesh.texture is not None and mesh.texture.shape == (8, 8, 3)
        assert len(mesh.symmetries.continuous) == 1
        (pack / "photos" / "old.jpg").touch()
    assert main([*given, str(pack)]) == 0
    assert [path.name for path in (pack / "photos").iterdir()] == ["00000.jpg"]


@pytest.mark.parametrize("name", ["thesis.txt", "meshes", "out"])
def test_any_other_folder_is_left_alone(given: list[str], tmp_path: Path, name: str) -> None:
    pack = tmp_path / "pack"
    if name == "out":  # weights of a training that was run in the pack
        assert main([*given, str(pack)]) == 0
    (pack / name).mkdir(parents=True)
    (pack / name / "work").write_text("years")
    with pytest.raises(InputError, match=f"pack holds {name}, which is not of a pack"):
        main([*given, str(pack)])
    assert (pack / name / "work").read_text() == "years"


def test_a_mesh_of_one_colour_is_packed_and_compared_as_training_takes_it(
    given: list[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    box = trimesh.creation.box((0.05, 0.06, 0.07))
    box.visual.face_colors = (90, 120, 30, 255)
    box.export(tmp_path / "meshes" / "a_box.ply")
    assert main([*given, str(tmp_path / "pack")]) == 0
    monkeypatch.setattr(probe_gpu, "CUDA", torch.device("cpu"))
    monkeypatch.setattr(probe_gpu, "BankRenderer", lambda bank: BankRenderer(bank, compiled()))
    probe_gpu._compare(tmp_path / "pack")
    assert "renderings as ray casting" in capsys.readouterr().out


def test_a_pack_that_is_too_large_says_so(
    given: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pack_for_gpu, "LIMIT", 2**20)
    with pytest.raises(InputError, match="pack is larger than the 1 MiB that"):
        main([*given, str(tmp_path / "pack")])


@pytest.mark.parametrize(("unit", "size"), [("mm", 10), ("cm", 1)])
def test_the_unit_of_the_meshes_goes_along(
    given: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, unit: str, size: int
) -> None:
    box = trimesh.creation.box((5 * size, 6 * size, 7 * size))
    box.visual.face_colors = (90, 120, 30, 255)
    box.export(tmp_path / "meshes" / "a_box.ply")
    assert main([*given, str(tmp_path / "pack"), "--mesh_unit", unit]) == 0
    monkeypatch.setattr(probe_gpu, "CUDA", torch.device("cpu"))
    monkeypatch.setattr(probe_gpu, "BankRenderer", lambda bank: BankRenderer(bank, compiled()))
    probe_gpu._compare(tmp_path / "pack")
    assert (tmp_path / "pack" / "mesh_unit").read_text() == unit
