"""BOP data sets as people have them: unpadded names, other formats, sparse models_info.json."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.datasets.bop import BopDataset
from moveit6d.datasets.bop_layout import image_files, model_file, scene_folders
from moveit6d.errors import InputError
from tests.support.malformed import good_files
from tests.support.patches import BOX, textured_glb


@pytest.fixture
def root(tmp_path: Path) -> Path:
    files = next(files for name, _, files, _ in good_files() if name == "bop")
    for name, content in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_bytes(content)
    return tmp_path


DIAMETER = float(np.linalg.norm((0.1, 0.08, 0.06)))


@pytest.mark.parametrize(
    "info",
    [
        {"1": {"symmetries_discrete": None, "symmetries_continuous": None}},
        {"1": {}},
        {"1": None},
        {"2": {"diameter": 5}},
        None,
    ],
)
def test_a_diameter_that_is_not_given_is_measured(root: Path, info: Any) -> None:
    path = root / "models" / "models_info.json"
    path.unlink() if info is None else path.write_text(json.dumps(info))
    dataset = BopDataset(root, "test")
    assert dataset.diameter(1) == pytest.approx(DIAMETER, rel=1e-5)
    assert not dataset.is_symmetric(1) and dataset.mesh(1).symmetries.is_trivial


def test_a_given_diameter_counts(root: Path) -> None:
    assert BopDataset(root, "test").diameter(1) == pytest.approx(0.1414)
    (root / "models" / "models_info.json").write_text('{"1": {"diameter": -3}}')
    with pytest.raises(InputError, match="diameter of object 1 must be above 0"):
        BopDataset(root, "test").diameter(1)


@pytest.mark.parametrize("name", ["1", "01", "000001"])
@pytest.mark.parametrize("image", ["0.png", "000.PNG", "000000.png", "0.JPG"])
def test_names_need_no_zeros(root: Path, name: str, image: str) -> None:
    (root / "test" / "000001").rename(root / "test" / name)
    rgb = root / "test" / name / "rgb"
    (rgb / "000000.png").rename(rgb / image)
    dataset = BopDataset(root, "test")
    assert dataset.scenes() == [1] and dataset.images(1) == [0]
    assert dataset.image(1, 0).shape == (64, 96, 3)
    assert dataset.truth(1, 0)[0].object == 1


@pytest.mark.parametrize("unit", ["m", "mm"])
def test_models_of_other_formats_and_units(root: Path, unit: str) -> None:
    (root / "models" / "obj_000001.ply").unlink()
    glb = textured_glb()
    if unit == "mm":
        glb.json["nodes"][0]["scale"] = [1000, 1000, 1000]
    glb.write(root / "models" / "obj_1.glb")
    mesh = BopDataset(root, "test", mesh_unit=unit).mesh(1)  # type: ignore[arg-type]
    assert mesh.texture is not None and mesh.diameter == pytest.approx(DIAMETER, rel=1e-5)
    if unit == "m":
        with pytest.raises(InputError, match="looks like unit 'm'"):
            BopDataset(root, "test").mesh(1)


def test_padded_names_and_ply_files_come_first(tmp_path: Path) -> None:
    for name in ("5", "000005", "7", "notes"):
        (tmp_path / name).mkdir()
    assert scene_folders(tmp_path) == {5: tmp_path / "000005", 7: tmp_path / "7"}
    for name in ("3.jpg", "000003.png", "000003.txt", "x.png"):
        (tmp_path / name).touch()
    assert image_files(tmp_path) == {3: tmp_path / "000003.png"}
    for name in ("obj_2.obj", "obj_000002.ply"):
        (tmp_path / name).touch()
    assert model_file(tmp_path, 2) == tmp_path / "obj_000002.ply"
    assert model_file(tmp_path, 9) is None


def test_colours_of_a_model_are_shown(root: Path) -> None:
    shown = BopDataset(root, "test").mesh(1).vertex_colors
    assert shown is not None
    assert {tuple(row) for row in shown.tolist()} == {tuple(p[2].tolist()) for p in BOX.patches}
