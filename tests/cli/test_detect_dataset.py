"""`moveit6d detect --dataset`: a line for every target."""

from __future__ import annotations

from pathlib import Path
from typing import Any

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
