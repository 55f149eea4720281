"""Boxes of a detector's file in BOP's format, and the true ones of a data set."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from moveit6d.datasets.bop import BopDataset, BopTarget, Instance
from moveit6d.datasets.bop_boxes import read_boxes, true_boxes
from moveit6d.datasets.bop_writer import BopImage, write_bop
from moveit6d.errors import InputError


def detection(score: float, left: float, item: int = 4) -> dict[str, Any]:
    """One entry as in BOP's files of default detections."""
    return {
        "scene_id": 3,
        "image_id": 7,
        "category_id": item,
        "bbox": [left, 20, 30.5, 40],
        "score": score,
        "time": 0.1,
    }


def test_a_detectors_boxes_come_by_object_the_best_first(tmp_path: Path) -> None:
    path = tmp_path / "detections.json"
    path.write_text(json.dumps([detection(0.2, 1), detection(0.9, 2), detection(0.5, 3, 9)]))
    boxes = read_boxes(path)
    assert boxes[3, 7, 4] == [(2, 20, 30.5, 40), (1, 20, 30.5, 40)]
    assert boxes[3, 7, 9] == [(3, 20, 30.5, 40)] and len(boxes) == 2


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ([], "holds no detection"),
        ([{"scene_id": 3, "image_id": 7, "bbox": [1, 2, 3, 4]}], "detection 1.*category_id"),
        ([detection(1, 1) | {"bbox": [1, 2, 3]}], "detection 1: bbox"),
        ([detection(1, 1), detection(1, 1) | {"score": "high"}], "detection 2: score"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path: Path, content: Any, words: str) -> None:
    path = tmp_path / "detections.json"
    path.write_text(json.dumps(content))
    with pytest.raises(InputError, match=words):
        read_boxes(path)


def test_true_boxes_are_those_of_what_is_visible(tmp_path: Path, scene: Any) -> None:
    pose = scene.pose(0)
    truth = [Instance(4, pose, 0.2, (1, 2, 3, 4)), Instance(4, pose, 0.9, (5, 6, 7, 8))]
    truth.append(Instance(4, pose, 0.0, (-1, -1, -1, -1)))
    images = [BopImage(3, 7, scene.image(0), scene.camera, truth)]
    root = write_bop(tmp_path / "set", "test", {4: scene.mesh}, images)
    dataset, target = BopDataset(root, "test"), BopTarget(3, 7, 4, 2)
    assert true_boxes(dataset, [target]) == {(3, 7, 4): [(5, 6, 7, 8), (1, 2, 3, 4)]}
    assert [one.box for one in dataset.truth(3, 7)] == [(1, 2, 3, 4), (5, 6, 7, 8), None]


def test_a_data_set_without_boxes_is_refused(root: Path) -> None:
    dataset = BopDataset(root, "test")
    with pytest.raises(InputError, match="bbox_visib"):
        true_boxes(dataset, dataset.targets())
