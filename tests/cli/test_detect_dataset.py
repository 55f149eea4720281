"""`moveit6d detect --dataset`: a line for every target."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import torch

from moveit6d.cli.main import main
from moveit6d.datasets.bop import Instance, read_results
from moveit6d.datasets.bop_writer import BopImage, write_bop


def near(found: Any, true: Any) -> bool:
    return float((found.translation - true.translation).norm()) < 0.01


def test_every_target_of_a_data_set_gets_a_line(tmp_path: Path, scene: Any, capsys: Any) -> None:
    images = [
        BopImage(1, number, scene.image(number), scene.camera, [Instance(7, scene.pose(number))])
        for number in (0, 3)
    ]
    root = write_bop(tmp_path / "set", "test", {7: scene.mesh}, images)
    out = tmp_path / "results.csv"
    command = ["detect", "--dataset", str(root), "--split", "test", "--output", str(out)]
    assert main([*command, "--targets", "test_targets_bop19.json"]) == 0
    assert "2 poses in 2 images" in capsys.readouterr().out
    found = read_results(out)
    assert [(e.scene, e.image, e.object) for e in found] == [(1, 0, 7), (1, 3, 7)]
    assert all(near(e.pose, scene.pose(e.image)) and e.score > 0.5 for e in found)
    assert found[0].seconds > 0
    assert main([*command, "--box", "0", "0", "9", "9"]) == 2
    assert "--box is not for --dataset" in capsys.readouterr().err


def test_with_boxes_only_they_are_looked_into(tmp_path: Path, scene: Any, capsys: Any) -> None:
    vertices = torch.from_numpy(scene.mesh.vertices).to(torch.float64)
    corners = scene.camera.project(scene.pose(0).transform(vertices))
    (left, top), (right, bottom) = corners.amin(0).tolist(), corners.amax(0).tolist()
    visible = (left, top, right - left, bottom - top)
    truth = [Instance(7, scene.pose(0), 1.0, visible)]
    images = [BopImage(1, 0, scene.image(0), scene.camera, truth)]
    root = write_bop(tmp_path / "set", "test", {7: scene.mesh}, images)
    out = tmp_path / "results.csv"
    command = ["detect", "--dataset", str(root), "--split", "test", "--output", str(out)]
    assert main([*command, "--boxes", "truth"]) == 0
    (found,) = read_results(out)
    assert near(found.pose, scene.pose(0)) and found.score > 0.5
    one = {"scene_id": 1, "image_id": 0, "category_id": 7}
    boxes = [one | {"bbox": [5, 5, 20, 20], "score": 0.3}, one | {"bbox": visible, "score": 0.2}]
    boxes.append(one | {"bbox": [9, 9, 3, 30], "score": 0.9})
    (tmp_path / "boxes.json").write_text(json.dumps(boxes))
    capsys.readouterr()
    assert main([*command, "--boxes", str(tmp_path / "boxes.json")]) == 0
    assert "1 of 3 boxes are less than 4 pixels" in capsys.readouterr().err
    for other in read_results(out):  # of one instance, the best box: it is the wrong one
        assert not near(other.pose, scene.pose(0)) and other.score < 0.5
    boxes = [one | {"bbox": [5000, 5, 20, 20], "score": 0.9}]
    (tmp_path / "outside.json").write_text(json.dumps(boxes))
    out.unlink(missing_ok=True)
    assert main([*command, "--boxes", str(tmp_path / "outside.json")]) == 0
    assert "scene 1, image 0, object 7: box 5000 5 20 20" in capsys.readouterr().err
