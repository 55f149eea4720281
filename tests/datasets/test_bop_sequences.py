"""A scene of a BOP split is a sequence for each of its objects."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.datasets.bop import BopDataset
from moveit6d.datasets.bop_sequences import read_bop_sequences
from moveit6d.errors import InputError


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
    with pytest.raises(InputError, match="a target has no scene_id"):
        BopDataset(root, "test").targets()


def test_missing_and_damaged_images_are_frames_with_an_error(root: Path, scene: Any) -> None:
    (root / "test" / "000003" / "rgb" / "000001.png").unlink()
    (root / "test" / "000003" / "rgb" / "000002.png").write_bytes(b"nothing")
    four, _ = read_bop_sequences(root)
    assert (four.camera.width, four.camera.height) == (scene.camera.width, scene.camera.height)
    frames = list(four.open())
    assert [frame.error is None for frame in frames] == [False, False, True]
    assert frames[0].name == "000001.png" and "does not exist" in str(frames[0].error)
    assert (four.truth[2].matrix - scene.pose(7).matrix).abs().max() < 1e-9
    (root / "test" / "000003" / "rgb" / "000007.png").unlink()
    with pytest.raises(InputError, match=r"000001\.png does not exist"):
        read_bop_sequences(root)


def test_an_image_without_truth_has_none(root: Path) -> None:
    place = root / "test" / "000003" / "scene_gt.json"
    content = json.loads(place.read_text())
    del content["2"]
    place.write_text(json.dumps(content))
    four, nine = read_bop_sequences(root)
    assert list(four.truth) == [0, 2] and list(nine.truth) == [0]
    assert len(list(four.open())) == 3
    with pytest.raises(InputError, match="image 2: not there"):
        BopDataset(root, "test").truth(3, 2)
