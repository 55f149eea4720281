"""BOP data sets and result files: units, symmetries, order, and where the reader looked."""

from __future__ import annotations

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import torch
from PIL import Image as Pillow

from moveit6d.datasets.bop import (
    BopDataset,
    read_results,
)
from moveit6d.errors import InputError


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A data set with one object, one scene, two images."""
    import trimesh

    root = tmp_path / "tiny"
    scene = root / "test" / "000002"
    (scene / "rgb").mkdir(parents=True)
    (root / "models").mkdir()
    trimesh.creation.box((100, 60, 40)).export(root / "models" / "obj_000005.ply")
    turn = [-1, 0, 0, 8, 0, -1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
    info = {"5": {"diameter": 123.3, "symmetries_discrete": [turn]}, "6": {"diameter": 50.0}}
    (root / "models" / "models_info.json").write_text(json.dumps(info))
    k = [500.0, 0, 320.5, 0, 501.0, 240.5, 0, 0, 1]
    cameras = {str(n): {"cam_K": [k[0] + n, *k[1:]], "depth_scale": 1} for n in (3, 17)}
    (scene / "scene_camera.json").write_text(json.dumps(cameras))
    skewed = (np.eye(3) + 0.004 * np.ones((3, 3))).reshape(-1).tolist()
    truth = {"3": [{"cam_R_m2c": skewed, "cam_t_m2c": [10.0, -20.0, 800.0], "obj_id": 5}]}
    (scene / "scene_gt.json").write_text(json.dumps(truth))
    Pillow.new("RGB", (64, 48), (9, 8, 7)).save(scene / "rgb" / "000003.png")
    Pillow.new("RGB", (64, 48), (9, 8, 7)).save(scene / "rgb" / "000017.jpg")
    return root


def test_a_split_is_read_in_metres(root: Path) -> None:
    dataset = BopDataset(root, "test")
    assert dataset.scenes() == [2] and dataset.images(2) == [3, 17]
    camera = dataset.camera(2, 17)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == (517.0, 501.0, 320.5, 240.5)
    assert (camera.width, camera.height) == (64, 48)
    assert dataset.image(2, 3)[0, 0].tolist() == [9, 8, 7]
    (one,) = dataset.truth(2, 3)
    assert one.object == 5 and one.pose.translation.tolist() == [0.01, -0.02, 0.8]
    assert dataset.diameter(5) == pytest.approx(0.1233)
    mesh = dataset.mesh(5)
    assert mesh.diameter == pytest.approx(np.sqrt(100**2 + 60**2 + 40**2) / 1000, rel=1e-4)
    assert mesh is dataset.mesh(5)


def test_rotations_that_are_not_orthonormal_are_projected(root: Path) -> None:
    rotation = BopDataset(root, "test").truth(2, 3)[0].pose.rotation
    identity = torch.eye(3, dtype=torch.float64)
    torch.testing.assert_close(rotation @ rotation.mT, identity, rtol=0, atol=1e-12)


def test_symmetries_come_in_metres(root: Path) -> None:
    dataset = BopDataset(root, "test")
    assert dataset.is_symmetric(5) and not dataset.is_symmetric(6)
    assert dataset.mesh(5).symmetries.discrete[0, 0, 3] == pytest.approx(0.008)


@pytest.mark.parametrize(
    ("ask", "words"),
    [
        (lambda root: BopDataset(root / "no", "test"), "is not a folder"),
        (lambda root: BopDataset(root, "val"), "no split 'val'; folders there: test"),
        (lambda root: BopDataset(root, "test").image(9, 3), "scenes there: 2"),
        (lambda root: BopDataset(root, "test").image(2, 4), r"rgb/000004\.png or \.jpg"),
        (lambda root: BopDataset(root, "test").camera(2, 4), "does not know image 4"),
        (lambda root: BopDataset(root, "test").truth(2, 17), "image 17: not there"),
        (lambda root: BopDataset(root, "test").mesh(7), "does not know object 7; it knows 5, 6"),
        (lambda root: BopDataset(root, "test").mesh(6), r"there is no mesh .*obj_000006\.ply"),
    ],
)
def test_what_is_missing_says_where_it_looked(root: Path, ask: object, words: str) -> None:
    with pytest.raises(InputError, match=words):
        ask(root)  # type: ignore[operator]


def test_a_data_set_without_models_is_said(root: Path) -> None:
    shutil.rmtree(root / "models")
    with pytest.raises(InputError, match=r"has no models: looked for obj_000001\.ply"):
        BopDataset(root, "test").mesh(5)


def test_the_shared_linemod_split_is_read(shared: Path) -> None:
    dataset = BopDataset(shared / "data" / "real" / "lmo_dev", "test")
    rows = read_results(dataset.root / "initial_small.csv")
    assert len(rows) == 717 and len(dataset.images(2)) == 100
    assert [n for n in (1, 5, 6, 8, 9, 10, 11, 12) if dataset.is_symmetric(n)] == [10, 11]
    for one in dataset.truth(2, 3):
        r = one.pose.rotation
        assert torch.allclose(r @ r.mT, torch.eye(3, dtype=torch.float64), atol=1e-9)
