"""Several objects on the command line: units, starts, names, paint."""

from __future__ import annotations

import csv
import json
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from moveit6d import InputError, Pose, PoseTracker
from moveit6d.cli.main import main
from moveit6d.cli.objects import load_meshes, note_without_colours, object_names, read_starts
from tests.support.clip import Clip, write_other

FLAGS = {"allow_untextured": False, "texture_from_start": False}


@pytest.mark.parametrize(
    ("paths", "names"),
    [
        (["a/cup.ply"], [""]),
        (["a/cup.ply", "can.ply"], ["cup", "can"]),
        (["cup.ply", "can.ply", "./cup.ply"], ["cup_1", "can", "cup_2"]),
        (["x/cup.glb", "y/cup.glb", "cup_1.glb"], ["x", "y", "cup_1"]),
        (["tool/textured_simple.obj", "can/textured_simple.obj"], ["tool", "can"]),
        (["x/cup.glb", "y/cup.glb", "x/cup.glb"], ["x_1", "y", "x_2"]),
        (["x/cup.glb", "y/cup.glb", "x.glb"], ["x_cup", "y_cup", "x"]),
        (["x/a.glb", "y/a.glb", "x/b.glb", "y/b.glb"], ["x_a", "y_a", "x_b", "y_b"]),
        (["x/cup.ply", "x/cup.glb"], ["x_cup_1", "x_cup_2"]),
        (["cup.glb", "cup.glb", "cup_1.glb"], ["cup_2", "cup_3", "cup_1"]),
    ],
)
def test_names_are_those_of_files_or_folders_and_each_is_there_once(
    paths: list[str], names: list[str]
) -> None:
    assert object_names([Path(path) for path in paths]) == names


def test_units_are_one_or_one_each(brick_file: Path) -> None:
    meshes = load_meshes(Namespace(mesh=[brick_file] * 2, mesh_unit=["m"], **FLAGS))
    assert len(meshes) == 2
    with pytest.raises(InputError, match="3 times --mesh but 2 times --mesh_unit"):
        load_meshes(Namespace(mesh=[brick_file] * 3, mesh_unit=["m", "mm"], **FLAGS))


def test_starts_are_one_each_or_none_at_all(tmp_path: Path) -> None:
    Pose.identity().save(tmp_path / "a.json")
    assert read_starts(Namespace(start=None, exact_start=False), 2) == [None, None]
    given = [tmp_path / "a.json", None]
    known, unknown = read_starts(Namespace(start=given, exact_start=False), 2)
    assert known is not None and unknown is None
    with pytest.raises(InputError, match="all poses: give --start for each mesh"):
        read_starts(Namespace(start=given, exact_start=True), 2)
    with pytest.raises(InputError, match="2 times --mesh but 1 times --start"):
        read_starts(Namespace(start=[tmp_path / "a.json"], exact_start=False), 2)
    with pytest.raises(InputError, match="give --start"):
        read_starts(Namespace(start=None, exact_start=True), 1)


def test_a_mesh_without_colours_is_not_passed_over(brick_file: Path, capsys: Any) -> None:
    import trimesh

    from moveit6d import Mesh

    box = trimesh.creation.box((0.1, 0.1, 0.1))
    plain = Mesh.from_arrays("part", box.vertices, box.faces)
    given = Namespace(texture_from_start=False)
    note_without_colours(given, [plain])
    assert "part has no colours" in capsys.readouterr().err
    note_without_colours(given, [plain], remembered=True)
    note_without_colours(given, [Mesh.load(brick_file)])
    note_without_colours(Namespace(texture_from_start=True), [plain])
    assert capsys.readouterr().err == ""


def test_two_objects_are_tracked_side_by_side(
    make_sequence: Callable[..., Any], scene: Any, use_oracle: Callable[..., None], tmp_path: Path,
    capsys: Any,
) -> None:  # fmt: skip
    made = make_sequence("clip", frames=2, still=True)
    use_oracle(scene.mesh, made.poses[0], targets=2)
    mesh, start = str(made.folder / "mesh.ply"), str(made.folder / "start.json")
    other, out = str(write_other(made.folder)), tmp_path / "out"
    command = [
        "track", "--mesh", mesh, "--mesh", other, "--mesh_unit", "m", "--video",
        str(made.folder / "frames"), "--camera", str(made.folder / "camera.json"),
        "--start", start, "--start", start, "--output", str(out),
    ]  # fmt: skip
    assert main(command) == 0
    rows = list(csv.DictReader((out / "poses.csv").read_text().splitlines()))
    assert [(row["frame"], row["object"]) for row in rows] == [
        ("0", "mesh"), ("0", "other"), ("1", "mesh"), ("1", "other"),
    ]  # fmt: skip
    assert list(rows[0])[-2:] == ["object", "state"] and rows[0]["state"] == "tracking"
    assert rows[0]["tx"] == rows[1]["tx"]
    summary = json.loads((out / "summary.json").read_text())
    assert summary["objects"]["other"]["states"] == {"tracking": 2}
    assert "other: 2 frames, 0 failed" in capsys.readouterr().out


def test_a_known_object_beside_one_that_is_looked_for(
    clip: Clip, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    asked: list[Any] = []

    def begin(self: Any, meshes: Any, camera: Any, start: Any, **given: Any) -> None:
        asked.append((start, given["config"].recovery.distance, given["found"]))
        raise InputError("That is enough.")

    monkeypatch.setattr(PoseTracker, "__init__", begin)
    start = str(clip.folder / "start.json")
    command = [
        "--mesh", str(write_other(clip.folder)), "--no_overlay", "--distance", "0.3", "0.9",
        "--start",
    ]  # fmt: skip
    assert clip.track(*command, "none") == 2
    (((known, unknown), distance, found),) = asked
    assert known.translation.tolist() == Pose.load(Path(start)).translation.tolist()
    assert unknown is None and distance == (0.3, 0.9) and not any(found)
    assert clip.track(*command, start) == 2 and len(asked) == 1
    assert "--start says the pose; leave out" in capsys.readouterr().err


def test_a_plain_mesh_is_painted_and_followed(
    make_sequence: Callable[..., Any], scene: Any, tmp_path: Path
) -> None:
    import trimesh

    made = make_sequence("clip", frames=4)
    box = trimesh.creation.box((0.12, 0.08, 0.05))
    box.apply_translation((0.03, -0.01, 0.02))
    box.export(tmp_path / "plain.stl")
    out = tmp_path / "out"
    assert main([
        "track", "--mesh", str(tmp_path / "plain.stl"), "--mesh_unit", "m", "--video",
        str(made.folder / "frames"), "--camera", str(made.folder / "camera.json"),
        "--start", str(made.folder / "start.json"), "--output", str(out), "--no_overlay",
        "--texture_from_start",
    ]) == 0  # fmt: skip
    last = list(csv.DictReader((out / "poses.csv").read_text().splitlines()))[-1]
    found = torch.tensor([float(last[k]) for k in ("tx", "ty", "tz")], dtype=torch.float64)
    assert float((found - made.poses[-1].translation).norm()) < 0.02
    assert last["state"] == "tracking"
