"""A whole small BOP tree: written, and read back by our reader and as sequences."""

from __future__ import annotations

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
from moveit6d.geometry.symmetry import Symmetries
from tests.support.bop_by_hand import TURN


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


@pytest.mark.parametrize(("far", "step"), [(6.5, 0.1), (9.0, 1.0), (65.0, 1.0)])
def test_depth_does_not_wrap_round(tmp_path: Path, scene: Any, far: float, step: float) -> None:
    depth = np.full((120, 160), 0.5004, np.float32)
    depth[0, :6] = far, np.nan, np.inf, -np.inf, -0.5, 66.0 if far > 10 else far
    image = BopImage(3, 1, scene.image(1), scene.camera, [], depth)
    dataset = BopDataset(write_bop(tmp_path / "set", "test", {4: scene.mesh}, [image]), "test")
    back = dataset.depth(3, 1)
    assert back is not None
    expected = [far, 0, 0, 0, 0, 0 if far > 10 else far, 0.5004]
    np.testing.assert_allclose(back[0, :7], expected, atol=0.51e-3 * step)


def test_a_lens_is_refused(tmp_path: Path, scene: Any) -> None:
    camera = replace(scene.camera, distortion=(0.1, 0, 0, 0))
    image = BopImage(3, 1, scene.image(1), camera, [])
    with pytest.raises(InputError, match=r"image 1: scene_camera\.json holds no lens distortion"):
        write_bop(tmp_path / "set", "test", {4: scene.mesh}, [image])


def pictures(scene: Any, object: int, *places: tuple[int, int]) -> list[BopImage]:
    """Images of one object, by scene and number."""
    return [
        BopImage(
            place, number, scene.image(number), scene.camera, [Instance(object, scene.pose(1))]
        )
        for place, number in places
    ]


def test_another_split_leaves_models_and_targets_as_they_are(
    root: Path, scene: Any, objects: dict[int, Mesh], brick: Mesh
) -> None:
    names = ("models/models_info.json", "models/obj_000004.ply", "test_targets_bop19.json")
    before = [(root / name).read_bytes() for name in names]
    write_bop(root, "val", {4: objects[4]}, pictures(scene, 4, (3, 1), (5, 2)))
    assert [(root / name).read_bytes() for name in names] == before
    val = BopDataset(root, "val")
    assert val.scenes() == [3, 5] and val.diameter(9) == pytest.approx(objects[9].diameter)
    write_bop(root, "val", {7: brick}, pictures(scene, 7, (6, 1)))
    assert BopDataset(root, "test").objects() == [4, 7, 9]
    assert sorted(path.suffix for path in (root / "models").iterdir()) == [".json"] + 3 * [".ply"]


def test_models_that_other_splits_use_are_not_replaced(
    root: Path, scene: Any, objects: dict[int, Mesh]
) -> None:
    before = {path: path.read_bytes() for path in (root / "models").iterdir()}
    for other in (objects[9], replace(objects[4], symmetries=Symmetries())):
        with pytest.raises(InputError, match=r"obj_000004\.ply is there and holds"):
            write_bop(root, "val", {2: objects[9], 4: other}, pictures(scene, 4, (3, 1)))
    assert {path: path.read_bytes() for path in (root / "models").iterdir()} == before
    assert not (root / "val").exists()


def test_targets_of_other_scenes_stay(root: Path, scene: Any, objects: dict[int, Mesh]) -> None:
    before = BopDataset(root, "test").targets()
    write_bop(root, "test", objects, pictures(scene, 4, (8, 1)))
    assert BopDataset(root, "test").targets() == [*before, BopTarget(8, 1, 4, 1)]
    write_bop(root, "test", objects, pictures(scene, 4, (3, 2)))
    expected = [BopTarget(8, 1, 4, 1), BopTarget(3, 2, 4, 1)]
    assert BopDataset(root, "test").targets() == expected
    with pytest.raises(InputError, match="lists the targets of the split 'test'; write 'test_b'"):
        write_bop(root, "test_b", objects, pictures(scene, 4, (3, 1)))
    assert BopDataset(root, "test").targets() == expected
