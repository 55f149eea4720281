"""`moveit6d evaluate bop --errors bop19` and `evaluate ycbv`: tables on made data."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d import extras
from moveit6d.cli.main import main
from moveit6d.datasets.bop import Estimate, Instance, write_results
from moveit6d.datasets.bop_writer import BopImage, write_bop
from moveit6d.datasets.pose_files import POSE_COLUMNS, PoseRow, read_poses, write_poses
from moveit6d.evaluation.ycbv.keyframes import Keyframes, write_keyframe_poses
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from tests.support.clip import write_other


def cells(text: str) -> list[list[str]]:
    lines = [line for line in text.splitlines() if line.startswith("|") and "---" not in line]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]


def at(z: float) -> Pose:
    return Pose(torch.eye(3, dtype=torch.float64), torch.tensor([0, 0, z], dtype=torch.float64))


@pytest.mark.parametrize("depth", [True, False])
def test_average_recall_of_two_files(brick: Mesh, tmp_path: Path, capsys: Any, depth: bool) -> None:
    camera = Camera(180.0, 182.0, 78.0, 61.0, 160, 120)
    measured = np.zeros((120, 160), np.float32) if depth else None  # nothing known: all visible
    picture = np.zeros((120, 160, 3), np.uint8)
    image = BopImage(1, 4, picture, camera, [Instance(3, at(0.6))], measured)
    root = write_bop(tmp_path / "tiny", "test", {3: brick}, [image])
    files = [tmp_path / "right.csv", tmp_path / "wrong.csv"]
    for file, z in zip(files, (0.6, 3.0), strict=True):
        write_results(file, [Estimate(1, 4, 3, 1.0, at(z), 0.5)])
    command = ["evaluate", "bop", "--dataset", str(root), "--split", "test", "--errors", "bop19"]
    assert main([*command, "--results", *map(str, files)]) == 0
    printed = capsys.readouterr()
    rows = cells(printed.out)
    assert rows[0][:3] == ["file", "instances", "AR"] and rows[1][0] == str(files[0])
    assert rows[1][4:7] == ["100.0 %", "100.0 %", "0.500"]
    assert rows[1][2:4] == (["100.0 %", "100.0 %"] if depth else ["-", "-"])
    assert rows[2][4] == "0.0 %" and (rows[2][2] == "0.0 %") == depth
    assert ("no depth images" in printed.err) != depth
    assert main([*command, "--results", str(files[0]), "--targets", "none.json"]) == 2
    assert "none.json" in capsys.readouterr().err


def test_reliability_of_bop_scores(brick: Mesh, tmp_path: Path, capsys: Any) -> None:
    camera, picture = Camera(180.0, 182.0, 78.0, 61.0, 160, 120), np.zeros((120, 160, 3), np.uint8)
    images = [BopImage(1, k, picture, camera, [Instance(3, at(0.6))], None) for k in range(4)]
    root = write_bop(tmp_path / "tiny", "test", {3: brick}, images)
    places, scores = (0.6, 0.6, 3.0, 3.0), (1.0, 0.8, 0.6, 0.4)
    estimates = [
        Estimate(1, k, 3, score, at(z), 0.5)
        for k, (z, score) in enumerate(zip(places, scores, strict=True))
    ]
    write_results(tmp_path / "found.csv", estimates)
    command = ["evaluate", "bop", "--dataset", str(root), "--split", "test"]
    command += ["--results", str(tmp_path / "found.csv")]
    assert main([*command, "--reliability", str(tmp_path / "diagram")]) == 0
    printed = capsys.readouterr().out
    assert "4 poses: AUROC 1.000" in printed
    assert "calibration error 0.300" in printed  # (0 + 0.2 + 0.6 + 0.4) / 4
    assert (tmp_path / "diagram.png").stat().st_size > 1000
    assert (tmp_path / "diagram.svg").exists()


@pytest.mark.parametrize(
    "words", [("bop19", "--reliability", "diagram"), ("add", "--targets", "test_targets.json")]
)
def test_options_of_the_other_errors_are_refused(words: tuple[str, ...], capsys: Any) -> None:
    command = ["evaluate", "bop", "--dataset", "none", "--split", "test", "--results", "none.csv"]
    assert main([*command, "--errors", *words]) == 2
    assert f"{words[1]} is not for --errors {words[0]}" in capsys.readouterr().err


def test_keyframe_poses_of_one_method(tmp_path: Path, capsys: Any) -> None:
    truth = Pose.stack([at(0.8)] * 4)
    moved = Pose.stack([at(0.8), at(0.85), at(0.85), at(1.2)])
    keyframes = Keyframes(
        torch.tensor([1, 1, 2, 2]), ("mug", "bowl"), truth, {"a": moved, "b": truth}
    )
    write_keyframe_poses(tmp_path / "poses.npz", keyframes)
    points = torch.tensor([[0.0, 0, 0], [0.01, 0, 0]]).numpy()
    np.savez(tmp_path / "points.npz", **{"01": points, "02": points})
    command = [
        "evaluate",
        "ycbv",
        "--poses",
        str(tmp_path / "poses.npz"),
        "--points",
        str(tmp_path / "points.npz"),
    ]
    assert main([*command, "--methods", "a", "--form", "exact", "--per_object"]) == 0
    rows = cells(capsys.readouterr().out)
    # Errors 0, 5 cm, 5 cm, 40 cm; areas of the objects 0.75 and 0.25.
    assert rows[1][:4] == ["a", "4", "0", "50.00"] and rows[1][6] == "50.00"
    assert [row[:2] for row in rows[3:]] == [["mug", "75.00"], ["bowl", "25.00"]]
    assert main([*command, "--symmetric", "bowl"]) == 0
    assert [row[0] for row in cells(capsys.readouterr().out)] == ["method", "a", "b"]
    assert main([*command, "--symmetric", "cup"]) == 2
    assert "has no object cup" in capsys.readouterr().err
    assert main([*command, "--methods", "c"]) == 2
    assert "holds no estimates c; there are a, b" in capsys.readouterr().err


def test_a_track_of_two_objects_is_scored(
    make_sequence: Any, scene: Any, use_oracle: Any, tmp_path: Path, capsys: Any
) -> None:
    made = make_sequence("two", frames=4, still=True)
    folder, pose = made.folder, scene.pose(0)
    rows = read_poses(folder / "poses.csv")
    both = [replace(row, object=name) for row in rows for name in ("cup", "plate")]
    write_poses(folder / "poses.csv", both, ("frame", "image", "object", *POSE_COLUMNS))
    use_oracle(scene.mesh, pose, targets=2)
    command = ["track", "--video", str(folder / "frames"), "--camera", str(folder / "camera.json")]
    write_other(folder).rename(folder / "plate.ply")
    (folder / "mesh.ply").rename(folder / "cup.ply")
    for name in ("cup", "plate"):
        command += ["--mesh", str(folder / f"{name}.ply"), "--start", str(folder / "start.json")]
    output = tmp_path / "out"
    assert main([*command, "--mesh_unit", "m", "--output", str(output)]) == 0
    capsys.readouterr()
    scoring = ["evaluate", "tracking", "--sequences", str(folder), "--results"]
    for results in (output, output / "poses.csv"):
        assert main([*scoring, str(results)]) == 0
        rows = cells(capsys.readouterr().out)
        assert [row[0] for row in rows] == ["level", "two.cup", "two.plate", "all"]
        assert [row[2] for row in rows[1:]] == ["100.0 %"] * 3


def test_a_track_of_the_later_frames_is_scored_from_there(
    make_sequence: Any, tmp_path: Path, capsys: Any
) -> None:
    made = make_sequence("clip", frames=8)
    rows = [
        PoseRow(k, f"{k + 3:06d}.png", pose, confidence=0.9)
        for k, pose in enumerate(made.poses[3:])
    ]
    write_poses(tmp_path / "out" / "poses.csv", rows)
    command = ["evaluate", "tracking", "--sequences", str(made.folder), "--results"]
    assert main([*command, str(tmp_path / "out")]) == 0
    printed = capsys.readouterr()
    assert cells(printed.out)[1][2:4] == ["100.0 %", "100.0 %"]
    assert "clip: its track begins with frame 3; the frames before are not scored" in printed.err


def test_targets_are_looked_for_in_the_working_folder_too(
    brick: Mesh, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    camera, picture = Camera(180.0, 182.0, 78.0, 61.0, 160, 120), np.zeros((120, 160, 3), np.uint8)
    images = [BopImage(1, k, picture, camera, [Instance(3, at(0.6))], None) for k in (4, 5)]
    root = write_bop(tmp_path / "tiny", "test", {3: brick}, images)
    write_results(tmp_path / "right.csv", [Estimate(1, 4, 3, 1.0, at(0.6), 0.5)])
    target = {"scene_id": 1, "im_id": 4, "obj_id": 3, "inst_count": 1}
    (tmp_path / "my.json").write_text(json.dumps([target]))
    monkeypatch.chdir(tmp_path)
    command = ["evaluate", "bop", "--dataset", str(root), "--split", "test", "--errors", "bop19"]
    command += ["--results", "right.csv"]
    found = []
    for more in ([], ["--targets", "my.json"], ["--targets", "test_targets_bop19.json"]):
        assert main([*command, *more]) == 0
        found.append(cells(capsys.readouterr().out)[1][1])
    assert found == ["2", "1", "2"]


def test_the_folder_of_a_track_is_scored(sequences: Path, tmp_path: Path, capsys: Any) -> None:
    track = tmp_path / "out"
    track.mkdir()
    (track / "poses.csv").write_bytes((sequences / "easy_00" / "poses.csv").read_bytes())
    command = ["evaluate", "tracking", "--results", str(track), "--sequences"]
    assert main([*command, str(sequences / "easy_00")]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith("\nout\n") and "100.0 %" in printed
    assert main([*command, str(sequences)]) == 2
    assert "its poses.csv is of one sequence" in capsys.readouterr().err
    (track / "poses.csv").unlink()
    assert main([*command, str(sequences / "easy_00")]) == 2
    assert "out holds no <sequence>.csv for any of easy_00.\n" in capsys.readouterr().err


def test_results_of_the_same_name_stand_beside_each_other(
    sequences: Path, tmp_path: Path, capsys: Any
) -> None:
    pytest.importorskip("matplotlib")
    rows = [replace(row, confidence=0.9) for row in read_poses(sequences / "easy_00" / "poses.csv")]
    places = [tmp_path / who / "out" for who in ("mine", "theirs")]
    for place in places:
        write_poses(place / "easy_00.csv", rows)
    command = ["evaluate", "tracking", "--sequences", str(sequences / "easy_00"), "--results"]
    diagram = ["--reliability", str(tmp_path / "diagram")]
    assert main([*command, *map(str, places), *diagram]) == 0
    lines = capsys.readouterr().out.splitlines()
    for place in places:
        assert str(place) in lines, "over its table"
        assert any(line.startswith(f"{place}: ") for line in lines), "and its reliability"


def test_a_diagram_without_matplotlib_is_refused_before_the_tables(
    monkeypatch: pytest.MonkeyPatch, sequences: Path, tmp_path: Path, capsys: Any
) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    command = ["evaluate", "tracking", "--sequences", str(sequences / "easy_00"), "--results"]
    assert main([*command, str(tmp_path), "--reliability", str(tmp_path / "diagram")]) == 2
    said = capsys.readouterr()
    assert "--reliability needs jinja2 and matplotlib" in said.err and not said.out
