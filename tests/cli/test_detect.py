"""`moveit6d detect`: images, what is known, data sets, and the answer that nothing is there."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from moveit6d.cli.detect_answers import POINTS_ERROR, Answer
from moveit6d.cli.main import main
from moveit6d.datasets.pose_files import read_poses, write_camera
from moveit6d.geometry.pose import Pose
from tests.support.settings_read import UNWRITTEN, offered, recorded

Detect = Callable[..., int]


@pytest.fixture
def folder(tmp_path: Path, scene: Any) -> Path:
    """Two frames of the brick, a picture without it, the camera."""
    Image.fromarray(scene.image(0)).save(tmp_path / "b.png")
    Image.fromarray(scene.image(6)).save(tmp_path / "a.png")
    noise = np.random.default_rng(0).integers(0, 255, (12, 16, 3), np.uint8)
    Image.fromarray(noise.repeat(10, 0).repeat(10, 1)).save(tmp_path / "none.png")
    write_camera(tmp_path / "camera.json", scene.camera)
    return tmp_path


@pytest.fixture
def detect(folder: Path, brick_file: Path) -> Detect:
    def run(images: list[str], *more: str) -> int:
        files = [str(folder / name) for name in images]
        return main([
            "detect", "--mesh", str(brick_file), "--mesh_unit", "m", "--image", *files,
            "--camera", str(folder / "camera.json"), "--output", str(folder / "out"), *more,
        ])  # fmt: skip

    return run


def near(found: Any, true: Any) -> bool:
    return float((found.translation - true.translation).norm()) < 0.01


def test_one_image_gives_a_start(detect: Detect, folder: Path, scene: Any, capsys: Any) -> None:
    assert detect(["b.png"]) == 0
    out = folder / "out"
    assert "probability" in capsys.readouterr().out
    assert near(Pose.load(out / "pose.json"), scene.pose(0))
    (row,) = read_poses(out / "poses.csv")
    assert (row.frame, row.state) == (0, "tracking") and (row.confidence or 0) > 0.5
    overlay = np.asarray(Image.open(out / "overlay.png"))
    assert overlay.shape == (120, 160, 3) and (overlay != scene.image(0)).any()
    facts = json.loads((out / "detection.json").read_text(encoding="utf-8"))
    assert facts["images"][0]["poses"][0]["accepted"] and facts["weights_sha256"]


@pytest.mark.parametrize("camera", ["--camera", "--fov"])
def test_one_image_is_decoded_once(
    folder: Path, brick_file: Path, monkeypatch: pytest.MonkeyPatch, camera: str
) -> None:
    from moveit6d.cli import detect_images
    from moveit6d.datasets import video

    read, once = list[Path](), video.read_image

    def recorded(path: Path, depth: Any = None) -> Any:
        read.append(path)
        return once(path, depth)

    monkeypatch.setattr(video, "read_image", recorded)
    monkeypatch.setattr(detect_images, "_answered", lambda *_: [Answer((), facts={})])
    value = {"--camera": str(folder / "camera.json"), "--fov": "60"}[camera]
    known = ["--mesh", str(brick_file), "--mesh_unit", "m", camera, value]
    image = folder / "b.png"
    assert main(["detect", *known, "--image", str(image), "--output", str(folder / "out")]) == 3
    assert read == [image]


def test_every_instance_gives_a_start(
    detect: Detect, folder: Path, scene: Any, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from moveit6d.cli import detect_images

    poses = tuple((scene.pose(frame), 0.9, 3, "stop_action") for frame in (0, 6))
    answers = iter([[Answer(poses, 0.9, 1.0, {})], [Answer((), facts={})]])
    monkeypatch.setattr(detect_images, "_answered", lambda *_: next(answers))
    assert detect(["b.png"], "--instances", "2") == 0
    said = capsys.readouterr().out
    assert said.startswith("found 2 of 2 instances, probability 0.90, 0.90: ")
    lines = (folder / "out" / "poses.csv").read_text().splitlines()
    assert lines[0].endswith(",instance,state")
    assert [line.split(",")[-2] for line in lines[1:]] == ["0", "1"]
    for name, frame in (("pose.json", 0), ("pose_2.json", 6)):
        assert near(Pose.load(folder / "out" / name), scene.pose(frame))
    assert detect(["b.png"], "--instances", "2") == 3
    assert not [*(folder / "out").glob("pose*.json")], "they are those of another run"


def test_every_object_has_rows_a_start_and_a_sentence(
    detect: Detect,
    folder: Path,
    brick_file: Path,
    scene: Any,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Any,
) -> None:
    from moveit6d.cli import detect_images

    def answer(*asked: Any) -> list[Answer]:
        poses = ((scene.pose(0), 0.9, 3, "stop_action"),)
        return [Answer((), 0.1, 5.0, {}), Answer(() if asked[1].index else poses, 0.9, 5.0, {})]

    monkeypatch.setattr(detect_images, "_answered", answer)
    (folder / "can.ply").write_bytes(brick_file.read_bytes())
    both, out = ["--mesh", str(folder / "can.ply")], folder / "out"
    assert detect(["b.png"], *both) == 0
    said = capsys.readouterr()
    assert said.out == (
        "brick: not found in b.png (probability of the best pose 0.10)\n"
        f"can: found in b.png, probability 0.90: {out / 'pose_can.json'}\n"
    )
    assert "not found: brick; narrow the search by --distance, or look for one object" in said.err
    assert near(Pose.load(out / "pose_can.json"), scene.pose(0))
    rows = read_poses(out / "poses.csv")
    assert [(row.object, row.state) for row in rows] == [("brick", "lost"), ("can", "tracking")]
    assert (np.asarray(Image.open(out / "overlay.png")) != scene.image(0)).any()
    facts = json.loads((out / "detection.json").read_text(encoding="utf-8"))
    assert facts["images"][0]["objects"] == {"brick": {}, "can": {}}
    assert detect(["b.png", "a.png"], *both) == 0
    said = capsys.readouterr()
    assert f"can: found in 1 of 2 images: {out / 'poses.csv'}" in said.out.splitlines()
    assert len(read_poses(out / "poses.csv")) == 4
    assert not [*out.glob("pose_*.json")], "they are those of another run"


def test_what_is_known_of_one_object_is_refused_with_several(
    detect: Detect, brick_file: Path, capsys: Any
) -> None:
    both = ["--mesh", str(brick_file)]
    assert detect(["b.png"], *both, "--box", "0", "0", "9", "9", "--start", "s.json") == 2
    assert "--box, --start is for one object; leave it out with several" in capsys.readouterr().err
    assert detect(["b.png"], *both, "--method", "seeds") == 2
    assert "--method seeds takes one --mesh and one --image" in capsys.readouterr().err
    assert detect(["b.png"], "--mesh_unit", "mm") == 2
    assert "1 times --mesh but 2 times --mesh_unit" in capsys.readouterr().err


def test_two_poses_are_not_written_to_one_file(
    detect: Detect, folder: Path, brick_file: Path, capsys: Any
) -> None:
    (folder / "brick_2.ply").write_bytes(brick_file.read_bytes())
    both = ["--mesh", str(folder / "brick_2.ply"), "--instances", "2"]
    assert detect(["b.png"], *both) == 2
    assert "Two poses would be written to pose_brick_2.json" in capsys.readouterr().err


def test_a_pose_that_is_only_clicked_is_counted_apart(
    detect: Detect, folder: Path, scene: Any, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from moveit6d.cli import detect_images

    pose = scene.pose(0)
    np.savetxt(folder / "p.csv", [[10 * k, 9, k, k * k, 0] for k in range(5)], delimiter=",")
    clicked = Answer(((pose, 0.0, 0, ""),), 0.0, 1.0, {POINTS_ERROR: 0.1})
    right = Answer(((pose, 0.9, 3, "stop_action"),), 0.9, 1.0, {})
    answers = iter([[right], [clicked], [clicked]])
    monkeypatch.setattr(detect_images, "_answered", lambda *_: next(answers))
    points, out = ["--points", str(folder / "p.csv")], folder / "out"
    assert detect(["b.png", "none.png"], *points) == 0
    said = capsys.readouterr()
    assert "--points are pixels of one image and are taken for all 2" in said.err
    assert said.out == (
        "found in 1 of 2 images; the pose clicked in 1 more is not confirmed: "
        f"{out / 'poses.csv'}\n"
    )
    assert detect(["none.png"], *points) == 3
    said = capsys.readouterr()
    assert not said.out and f"the pose as clicked is not confirmed: {out}/pose.json" in said.err
    assert near(Pose.load(out / "pose.json"), pose)


def test_an_edited_camera_is_another_one(
    detect: Detect, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from moveit6d.cli import detect_images

    def answer(*asked: Any) -> Any:
        if asked[1].index:
            raise KeyboardInterrupt
        return [Answer((), facts={})]

    monkeypatch.setattr(detect_images, "_answered", answer)
    assert detect(["b.png", "none.png"]) == 130
    text = (folder / "camera.json").read_text()
    (folder / "camera.json").write_text(text.replace('"fx": 1', '"fx": 2'))
    assert detect(["b.png", "none.png"], "--resume") == 2
    assert "belongs to a run with another camera;" in capsys.readouterr().err
    (folder / "camera.json").write_text(text)
    assert detect(["b.png", "none.png"], "--resume") == 130


def test_images_keep_their_order_and_absent_ones_a_row(
    detect: Detect, folder: Path, scene: Any, capsys: Any
) -> None:
    assert detect(["b.png", "none.png", "a.png"], "--distance", "0.3", "0.8") == 0
    assert "found in 2 of 3 images" in capsys.readouterr().out
    rows = read_poses(folder / "out" / "poses.csv")
    assert [row.image for row in rows] == ["b.png", "none.png", "a.png"]
    assert [row.state for row in rows] == ["tracking", "lost", "tracking"]
    assert near(rows[2].pose, scene.pose(6)) and rows[1].pose is None
    assert not (folder / "out" / "pose.json").exists()
    assert len(list((folder / "out" / "overlay").iterdir())) == 3


def test_not_found_is_exit_code_3_and_a_sentence(detect: Detect, folder: Path, capsys: Any) -> None:
    assert detect(["none.png"], "--distance", "0.4", "0.6") == 3
    message = capsys.readouterr().err.strip().splitlines()[-1]
    assert "none.png: the object was not found" in message
    assert "; check --distance" in message and "--box" in message
    assert not (folder / "out" / "pose.json").exists()
    assert (folder / "out" / "poses.csv").exists()


def test_what_is_known_comes_from_files(
    detect: Detect, folder: Path, scene: Any, brick_file: Path, capsys: Any
) -> None:
    true = scene.pose(0)
    true.save(folder / "start.json")
    assert detect(["b.png"], "--start", str(folder / "start.json")) == 0
    corners = torch.from_numpy(scene.mesh.vertices[::9].astype(float) + scene.mesh.center)
    pixels = scene.camera.project(true.transform(corners))
    with (folder / "points.csv").open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow("uvxyz")
        writer.writerows(torch.cat([pixels, corners], 1).tolist())
    assert detect(["b.png"], "--points", str(folder / "points.csv")) == 0
    assert near(Pose.load(folder / "out" / "pose.json"), true)
    u, v = scene.camera.project(scene.mesh.inner(true).translation).tolist()
    mask = np.zeros((120, 160), np.uint8)
    mask[max(0, int(v) - 14) : int(v) + 14, max(0, int(u) - 18) : int(u) + 18] = 255
    Image.fromarray(mask).save(folder / "mask.png")
    assert detect(["b.png"], "--mask", str(folder / "mask.png")) == 0
    box = [str(round(value)) for value in (u - 22, v - 18, 44, 36)]
    assert detect(["b.png"], "--box", *box) == 0
    assert near(Pose.load(folder / "out" / "pose.json"), true)
    capsys.readouterr()
    assert detect(["b.png"], "--mask", str(brick_file)) == 2
    assert "is not a readable image" in capsys.readouterr().err


def test_points_are_a_start_where_the_mesh_has_no_colours(
    folder: Path, scene: Any, capsys: Any
) -> None:
    true = scene.pose(0)
    corners = scene.mesh.vertices[::9].astype(float) + scene.mesh.center
    rows = [f"v {x} {y} {z}" for x, y, z in scene.mesh.vertices + scene.mesh.center]
    rows += [f"f {a} {b} {c}" for a, b, c in scene.mesh.faces + 1]
    (folder / "plain.obj").write_text("\n".join(rows))
    pixels = scene.camera.project(true.transform(torch.from_numpy(corners))).numpy()
    np.savetxt(folder / "points.csv", np.concatenate([pixels, corners], 1), delimiter=",")
    words = ["detect", "--mesh", str(folder / "plain.obj"), "--mesh_unit", "m", "--camera",
             str(folder / "camera.json"), "--points", str(folder / "points.csv"), "--image",
             str(folder / "none.png"), "--output", str(folder / "out")]  # fmt: skip
    assert main(words) == 3, "nothing in the picture speaks for the pose"
    said = capsys.readouterr()
    assert "does not confirm the pose of --points" in said.err and not said.out
    assert "plain has no colours, which is a likely reason" in said.err.splitlines()[-1]
    assert near(Pose.load(folder / "out" / "pose.json"), true)
    (row,) = read_poses(folder / "out" / "poses.csv")
    assert row.state == "uncertain" and near(row.pose, true)
    facts = json.loads((folder / "out" / "detection.json").read_text(encoding="utf-8"))
    assert facts["images"][0]["points_error_pixels"] < 0.1


def test_an_image_that_cannot_be_used_stops_no_others(
    detect: Detect, folder: Path, scene: Any, capsys: Any
) -> None:
    whole = (folder / "b.png").read_bytes()
    (folder / "cut.png").write_bytes(whole[: len(whole) // 2])
    Image.new("RGB", (40, 30)).save(folder / "small.png")
    assert detect(["cut.png", "b.png", "small.png"], "--distance", "0.4", "0.6") == 0
    said = capsys.readouterr().err
    assert "cut.png: " in said and "small.png: " in said and "Traceback" not in said
    rows = read_poses(folder / "out" / "poses.csv")
    assert [row.state for row in rows] == ["uncertain", "tracking", "uncertain"]
    assert near(rows[1].pose, scene.pose(0))
    assert detect(["b.png", "points.csv"]) == 2, "what is no image is said before the work"


def test_a_failed_run_leaves_an_earlier_one_as_it_was(
    detect: Detect, folder: Path, capsys: Any
) -> None:
    out = folder / "out"
    out.mkdir()
    names = ("poses.csv", "pose.json", "overlay.png", "detection.json", "poses.csv.unfinished")
    for name in names:
        (out / name).write_text("earlier")
    whole = (folder / "b.png").read_bytes()
    (folder / "cut.png").write_bytes(whole[: len(whole) // 2])
    Image.new("RGB", (80, 60)).save(folder / "small.png")
    assert detect(["cut.png"]) == 2
    assert detect(["small.png"]) == 2
    said = capsys.readouterr().err.splitlines()
    assert "cut.png is not a readable image" in said[0] and "small.png is 80×60" in said[1]
    assert "fx 90, fy 91, cx 38.75, cy 30.25" in said[1] and len(said) == 2
    assert {path.name for path in out.iterdir()} == set(names)
    assert detect(["b.png"], "--box", "0", "0", "1", "1") == 2, "found out late"
    left = {path.name: path.read_text() for path in out.iterdir()}
    assert left == dict.fromkeys(names, "earlier")


def test_the_first_answer_takes_the_place_of_an_earlier_run(
    detect: Detect, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    from moveit6d.cli import detect_images

    (folder / "out").mkdir()
    of_a_track = ("summary.json", "overlay.mp4")
    for name in ("poses.csv", "pose.json", "overlay.png", *of_a_track):
        (folder / "out" / name).write_text("earlier")
    own = {"files": ["poses.csv", "pose.json", "overlay.png", "detection.json"]}
    (folder / "out" / "detection.json").write_text(json.dumps(own))

    def answer(*_: Any) -> Any:
        return [Answer((), facts={})]

    monkeypatch.setattr(detect_images, "_answered", answer)
    assert detect(["b.png", "none.png"]) == 3
    left = {path.name for path in (folder / "out").iterdir()}
    assert left == {"poses.csv", "overlay", "detection.json"}
    facts = json.loads((folder / "out" / "detection.json").read_text(encoding="utf-8"))
    pictures = ["overlay/b.png.png", "overlay/none.png.png"]
    assert facts["files"] == ["poses.csv", "detection.json", *pictures]
    (folder / "out" / "pose.json").write_text("a start that somebody put here")
    for images in (["b.png", "none.png"], ["none.png"]):
        assert detect(images) == 3
        assert (folder / "out" / "pose.json").read_text() == "a start that somebody put here"
    assert [row.state for row in read_poses(folder / "out" / "poses.csv")] == ["lost"]


def test_a_folder_of_images_and_a_start_in_millimetres_are_named(
    detect: Detect, folder: Path, scene: Any, capsys: Any
) -> None:
    (folder / "frames").mkdir()
    assert detect(["frames"]) == 2
    said = capsys.readouterr().err
    assert said == (
        f"moveit6d: --image {folder}/frames is a folder; give its pictures, {folder}/frames/*.\n"
    )
    pose = scene.pose(0)
    Pose(pose.rotation, 1000 * pose.translation).save(folder / "mm.json")
    assert detect(["b.png"], "--start", str(folder / "mm.json")) == 2
    said = capsys.readouterr().err
    assert "mm.json: the object stands 501 m away; the translation looks like millim" in said


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--box", "0", "0", "1", "1"], "at least 4 wide"),
        (["--distance", "2", "1"], "nearer first"),
        (["--method", "seeds", "--box", "0", "0", "50", "50"], "leave out what narrows it"),
        (["--boxes", "truth"], "--boxes is not for --image, but for --dataset"),
        (["--split", "test", "--targets", "t.json"], "--split, --targets is not for --image"),
    ],
)
def test_what_cannot_be_used_is_refused(
    detect: Detect, more: list[str], words: str, capsys: Any
) -> None:
    assert detect(["b.png"], *more) == 2
    assert words in capsys.readouterr().err


def test_its_options_are_the_settings_that_it_reads(
    detect: Detect, folder: Path, scene: Any
) -> None:
    scene.pose(0).save(folder / "start.json")
    with recorded() as read:
        # Templates that are not known from another test.
        new = ["--detection.templates.rotations", "300", "--detection.templates.channels", "31"]
        assert detect(["b.png", "none.png"], "--distance", "0.3", "0.8", *new) == 0
        assert detect(["b.png"], "--start", str(folder / "start.json")) == 0
        box = ["--box", "30", "20", "100", "80", "--distance", "0.3", "0.8"]
        assert detect(["b.png"], *box) in (0, 3)
    assert read - UNWRITTEN == offered("detect")


@pytest.mark.parametrize(
    ("more", "words"),
    [
        (["--sizes", "0.9", "--seeds.spacing", "1"], "--sizes, --seeds.spacing is for --method se"),
        (["--max_iterations", "1"], "--loop.max_iterations changes nothing without --method seeds"),
        (["--method", "seeds", "--no_contour"], "--contour.enabled changes nothing with --method"),
    ],
)
def test_options_of_another_method_are_refused(
    detect: Detect, more: list[str], words: str, capsys: Any
) -> None:
    assert detect(["b.png"], *more) == 2
    assert words in capsys.readouterr().err


@pytest.mark.parametrize("option", ["--low_confidence", "--no_recovery", "--no_multi_start"])
def test_options_that_change_nothing_do_not_exist(detect: Detect, option: str, capsys: Any) -> None:
    with pytest.raises(SystemExit):
        detect(["b.png"], option, "0")
    assert f"there is no option {option}" in capsys.readouterr().err


def test_a_file_of_settings_may_hold_those_of_tracks(detect: Detect, folder: Path) -> None:
    (folder / "s.yaml").write_text("low_confidence: 0.4\nmotion: {enabled: false}\n")
    assert detect(["b.png"], "--config", str(folder / "s.yaml")) == 0


def test_missing_options_are_named(tmp_path: Path, capsys: Any) -> None:
    assert main(["detect", "--output", str(tmp_path / "out")]) == 2
    assert "--mesh, --mesh_unit, --image, --camera missing" in capsys.readouterr().err
    assert main(["detect", "--dataset", str(tmp_path), "--output", str(tmp_path / "o.csv")]) == 2
    assert "--split missing" in capsys.readouterr().err
    units = ["--mesh_unit", "m", "--mesh_unit", "mm", "--output", str(tmp_path / "o.csv")]
    assert main(["detect", "--dataset", str(tmp_path), "--split", "test", *units]) == 2
    assert "--dataset takes one --mesh_unit" in capsys.readouterr().err
