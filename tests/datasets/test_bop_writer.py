"""A whole small BOP tree: written, and read back by our reader and as sequences."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.datasets.bop import BopDataset, BopTarget, Instance
from moveit6d.datasets.bop_sequences import read_bop_sequences
from moveit6d.datasets.bop_writer import BopImage, write_bop
from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.symmetry import ContinuousSymmetry, Symmetries
from tests.support.meshes import colored_box

TURN = np.diag([-1.0, -1.0, 1.0, 1.0])
TURN[:3, 3] = (0.06, -0.02, 0.0)


@pytest.fixture
def objects(brick: Mesh) -> dict[int, Mesh]:
    axis = ContinuousSymmetry(np.array([0.0, 0.0, 1.0]), np.array([0.01, 0.0, 0.0]))
    return {
        4: replace(brick, symmetries=Symmetries(TURN[None], (axis,))),
        9: colored_box(),
    }


@pytest.fixture
def root(tmp_path: Path, scene: Any, objects: dict[int, Mesh]) -> Path:
    """One scene of three images; object 9 occurs twice in the last, once nearly hidden."""

    def image(number: int) -> BopImage:
        truth = [Instance(4, scene.pose(number), 0.75), Instance(9, scene.pose(number + 1), 0.5)]
        if number == 7:
            truth.append(Instance(9, scene.pose(number + 2), 0.05))
        depth = np.full((120, 160), 0.5 + number / 1000, np.float32)
        return BopImage(3, number, scene.image(number), scene.camera, truth, depth)

    return write_bop(tmp_path / "tiny", "test", objects, map(image, (1, 2, 7)))


def test_the_reader_finds_it_all(root: Path, scene: Any, objects: dict[int, Mesh]) -> None:
    dataset = BopDataset(root, "test")
    assert dataset.scenes() == [3] and dataset.images(3) == [1, 2, 7]
    assert dataset.camera(3, 7) == scene.camera
    np.testing.assert_array_equal(dataset.image(3, 2), scene.image(2))
    depth = dataset.depth(3, 7)
    assert depth is not None
    np.testing.assert_allclose(depth, 0.507, atol=5e-5)  # metres
    first, *others = dataset.truth(3, 7)
    assert (first.object, first.visible_fraction) == (4, 0.75)
    assert (first.pose.matrix - scene.pose(7).matrix).abs().max() < 1e-9
    assert [one.visible_fraction for one in others] == [0.5, 0.05]
    assert dataset.diameter(4) == pytest.approx(objects[4].diameter)
    back = dataset.mesh(4).symmetries
    np.testing.assert_allclose(back.discrete, TURN[None], atol=1e-9)
    np.testing.assert_allclose(back.continuous[0].offset, (0.01, 0, 0), atol=1e-9)
    np.testing.assert_allclose(dataset.mesh(4).center, objects[4].center, atol=1e-6)


def test_targets_count_what_can_be_seen(root: Path) -> None:
    targets = BopDataset(root, "test").targets()
    assert BopTarget(3, 7, 9, 1) in targets and len(targets) == 6


def test_evaluation_meshes_have_their_own_folder(root: Path, brick: Mesh) -> None:
    dataset = BopDataset(root, "test")
    assert dataset.eval_mesh(4) is dataset.mesh(4)
    (root / "models_eval").mkdir()
    (root / "models" / "obj_000009.ply").rename(root / "models_eval" / "obj_000004.ply")
    other = BopDataset(root, "test")
    assert other.eval_mesh(4).diameter != pytest.approx(other.mesh(4).diameter)
    assert not other.eval_mesh(4).symmetries.is_trivial


def test_cameras_side_by_side_are_told_apart_by_their_suffix(root: Path, scene: Any) -> None:
    place = root / "test" / "000003"
    for name in ("camera", "gt", "gt_info"):
        (place / f"scene_{name}.json").rename(place / f"scene_{name}_cam1.json")
    (place / "rgb").rename(place / "rgb_cam1")
    (place / "depth").rename(place / "depth_cam1")
    dataset = BopDataset(root, "test", "cam1")
    np.testing.assert_array_equal(dataset.image(3, 1), scene.image(1))
    assert dataset.depth(3, 1) is not None and len(dataset.truth(3, 1)) == 2
    (place / "rgb_cam1").rename(place / "cam1")  # as HOT3D has it
    np.testing.assert_array_equal(dataset.image(3, 1), scene.image(1))


def test_a_scene_is_a_sequence_for_each_object(root: Path, scene: Any) -> None:
    four, nine = read_bop_sequences(root)
    assert (four.name, nine.name, four.level) == ("000003.4", "000003.9", "4")
    assert list(four.truth) == [0, 1, 2]
    assert list(nine.truth) == [0, 1], "where it occurs twice nothing tells which is which"
    assert four.symmetric and not nine.symmetric
    assert not four.load_mesh().symmetries.is_trivial
    assert (four.truth[2].matrix - scene.pose(7).matrix).abs().max() < 1e-9
    np.testing.assert_array_equal([f.image for f in four.open()][2], scene.image(7))
    assert [one.name for one in read_bop_sequences(root / "test")] == [four.name, nine.name]


def test_what_is_missing_or_other_is_said(root: Path, tmp_path: Path) -> None:
    place = root / "test" / "000003" / "scene_camera.json"
    content = json.loads(place.read_text())
    content["7"]["cam_K"][0] += 1
    place.write_text(json.dumps(content))
    with pytest.raises(InputError, match="image 7 has other intrinsics than the first"):
        read_bop_sequences(root)
    content["7"] = {"cam_model": {}}
    place.write_text(json.dumps(content))
    with pytest.raises(InputError, match="image 7 has a cam_model"):
        BopDataset(root, "test").camera(3, 7)
    (tmp_path / "ycb" / "data" / "0048").mkdir(parents=True)
    (tmp_path / "ycb" / "data" / "0048" / "000001-meta.mat").touch()
    with pytest.raises(InputError, match="This is YCB-Video as published"):
        BopDataset(tmp_path / "ycb", "test")
    (tmp_path / "shards" / "test").mkdir(parents=True)
    with pytest.raises(InputError, match=r"holds no scene such as 000001/; .*shards"):
        read_bop_sequences(tmp_path / "shards")
    (root / "test_targets_bop19.json").write_text('[{"im_id": 1}]')
    with pytest.raises(InputError, match="a target needs scene_id and im_id"):
        BopDataset(root, "test").targets()


def test_no_depth_is_no_error(root: Path) -> None:
    (root / "test" / "000003" / "depth" / "000001.png").unlink()
    assert BopDataset(root, "test").depth(3, 1) is None


def test_the_shared_linemod_split_has_its_targets(shared: Path) -> None:
    dataset = BopDataset(shared / "data" / "real" / "lmo_dev", "test")
    targets = dataset.targets()
    assert len(targets) == 717 and targets[0] == BopTarget(2, 3, 1, 1)
    assert dataset.truth(2, 3)[0].visible_fraction == pytest.approx(0.19964507542147295)
    found = read_bop_sequences(dataset.root)
    assert len(found) == 8 and sum(len(one.truth) for one in found) >= 717
