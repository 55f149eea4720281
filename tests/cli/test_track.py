"""`moveit6d track` from files to files: results, bad frames, Ctrl-C, every kind of bad input."""

from __future__ import annotations

import itertools
import json
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
import pytest
import torch
from PIL import Image

from moveit6d.datasets.pose_files import TRACK_COLUMNS, read_poses
from moveit6d.evaluation.metrics import add
from moveit6d.geometry.pose import Pose
from tests.support.clip import Clip
from tests.support.settings_read import UNWRITTEN, offered, recorded

Make = Callable[..., Any]


def frames_in(path: Path) -> int:
    with av.open(str(path)) as container:
        return sum(1 for _ in container.decode(video=0))


def test_a_track_is_written_whole(clip: Clip, scene: Any, capsys: Any) -> None:
    assert clip.track() == 0
    assert sorted(p.name for p in clip.output.iterdir()) == [
        "overlay.mp4",
        "poses.csv",
        "start.png",
        "summary.json",
    ]
    text = (clip.output / "poses.csv").read_text().splitlines()
    assert text[0] == ",".join(TRACK_COLUMNS) and len(text) == 6
    rows = read_poses(clip.output / "poses.csv")
    points = torch.from_numpy(scene.mesh.sample_points(100))
    for frame, row in enumerate(rows):
        assert (row.frame, row.image) == (frame, f"{frame:06d}.png")
        assert row.pose is not None and float(add(row.pose, clip.true, points)) < 0.003
        assert row.stopped_by == "stop_action" and row.confidence == 1.0
    assert frames_in(clip.output / "overlay.mp4") == 5
    summary = clip.summary()
    assert (summary["frames"], summary["failed"], summary["lost_from_frame"]) == (5, 0, None)
    assert {row.state for row in rows} == {"tracking"} and summary["states"] == {"tracking": 5}
    assert summary["events"] == [{"state": "tracking", "first": 0, "last": 4}]
    assert summary["interrupted"] is False and summary["median_milliseconds"] > 0
    assert summary["arguments"]["mesh_unit"] == ["m"] and "torch" in summary["versions"]
    assert "5 frames, 0 failed" in capsys.readouterr().out


def test_no_overlay_leaves_it_out(clip: Clip) -> None:
    assert clip.track("--no_overlay", "--max_iterations", "1", "--threads", "1") == 0
    assert not (clip.output / "overlay.mp4").exists()
    assert {row.iterations for row in read_poses(clip.output / "poses.csv")} == {1}


def test_a_bad_frame_keeps_its_row_and_the_track_goes_on(clip: Clip, capsys: Any) -> None:
    (clip.folder / "frames" / "000001.png").write_bytes(b"\x89PNG broken")
    small = np.zeros((60, 80, 3), np.uint8)
    Image.fromarray(small).save(clip.folder / "frames" / "000003.png")
    assert clip.track() == 0
    rows = read_poses(clip.output / "poses.csv")
    assert [row.pose is None for row in rows] == [False, True, False, True, False]
    assert [row.frame for row in rows] == [0, 1, 2, 3, 4]
    line = (clip.output / "poses.csv").read_text().splitlines()[2]
    assert line == "1,000001.png,,,,,,,,,,,,,,failed,,,,uncertain"
    summary = clip.summary()
    assert summary["failed"] == 2
    assert "not a readable image" in summary["failures"][0]["error"]
    assert "80×60 but the camera is 160×120" in summary["failures"][1]["error"]
    assert frames_in(clip.output / "overlay.mp4") == 5
    said = capsys.readouterr().err.splitlines()
    assert [line[:17] for line in said] == ["moveit6d: frame 1", "moveit6d: frame 3"]


def test_the_same_failure_again_is_said_once(clip: Clip, capsys: Any) -> None:
    for number in (1, 2, 4):
        small = np.zeros((60, 80, 3), np.uint8)
        Image.fromarray(small).save(clip.folder / "frames" / f"{number:06d}.png")
    assert clip.track("--no_overlay") == 0
    said = capsys.readouterr().err.splitlines()
    assert [line[:17] for line in said] == ["moveit6d: frame 1", "moveit6d: frame 4"]
    assert clip.summary()["failed"] == 3


def write_video(clip: Clip, path: Path, frames: int) -> Path:
    image = np.asarray(Image.open(clip.folder / "frames" / "000000.png"))
    with av.open(str(path), "w", options={"movflags": "faststart"}) as container:
        stream = container.add_stream("libx264", rate=Fraction(30), options={"crf": "10"})
        stream.width, stream.height, stream.pix_fmt = 160, 120, "yuv420p"
        random = np.random.default_rng(0)
        for _ in range(frames):
            noisy = (image.astype(int) + random.integers(-9, 9, image.shape)).clip(0, 255)
            picture = av.VideoFrame.from_ndarray(noisy.astype(np.uint8), "rgb24")
            for packet in stream.encode(picture):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)
    return path


def test_a_video_file_is_tracked(clip: Clip, tmp_path: Path) -> None:
    video = write_video(clip, tmp_path / "clip.mp4", 8)
    assert clip.track("--no_overlay", video=str(video)) == 0
    rows = read_poses(clip.output / "poses.csv")
    assert len(rows) == 8 and all(row.pose is not None for row in rows)


def test_a_truncated_video_is_tracked_to_where_it_ends(clip: Clip, tmp_path: Path) -> None:
    video = write_video(clip, tmp_path / "clip.mp4", 30)
    video.write_bytes(video.read_bytes()[: video.stat().st_size // 2])
    assert clip.track("--no_overlay", video=str(video)) == 0
    rows = read_poses(clip.output / "poses.csv")
    assert 3 < len(rows) < 30 and rows[-1].pose is None and rows[0].pose is not None
    assert "cut off" in clip.summary()["failures"][-1]["error"]


def test_ctrl_c_keeps_what_was_done(clip: Clip, interrupt_update: Callable[[int], None]) -> None:
    interrupt_update(3)
    assert clip.track() == 130
    assert len(read_poses(clip.output / "poses.csv")) == 2
    assert frames_in(clip.output / "overlay.mp4") == 2
    assert clip.summary()["interrupted"] is True and clip.summary()["frames"] == 2
    assert len(list(clip.output.iterdir())) == 4, "no temporary file is left"


def test_a_camera_index_is_a_video(clip: Clip, capsys: Any) -> None:
    assert clip.track(video="97") == 2
    assert "camera 97 cannot be opened" in capsys.readouterr().err


def write_json(path: Path, content: object) -> str:
    path.write_text(json.dumps(content))
    return str(path)


EYE = [[1, 0, 0], [0, 1, 0], [0, 0, 1]]


def bad_inputs(clip: Clip, tmp: Path) -> dict[str, tuple[dict[str, str], str]]:
    """Name → (changed options, words of the message)."""

    starts = itertools.count()

    def pose(rotation: object, place: list[float]) -> dict[str, str]:
        content = {"rotation": rotation, "translation": place}
        return {"start": write_json(tmp / f"start{next(starts)}.json", content)}

    (tmp / "points.obj").write_text("v 0 0 0\nv 1 0 0\n")
    (tmp / "mesh.xyz").write_text("0 0 0")
    (tmp / "empty").mkdir()
    camera = {"fx": 180, "fy": 182, "cx": 78, "cy": 61, "width": 320, "height": 240}
    return {
        "no mesh": ({"mesh": str(tmp / "no.obj")}, "no.obj"),
        "mesh without faces": ({"mesh": str(tmp / "points.obj")}, "faces"),
        "foreign mesh": ({"mesh": str(tmp / "mesh.xyz")}, "must be one of"),
        "unit mix-up": ({"mesh_unit": "mm"}, "looks like unit 'm'"),
        "no video": ({"video": str(tmp / "no.mp4")}, "no.mp4 does not exist"),
        "empty folder": ({"video": str(tmp / "empty")}, "holds no images"),
        "text for video": ({"video": str(tmp / "mesh.xyz")}, "not a video"),
        "no camera": ({"camera": str(tmp / "no.json")}, "no.json does not exist"),
        "pose for camera": (
            {"camera": str(clip.folder / "start.json")},
            "fx, fy, cx, cy, width, height missing",
        ),
        "camera of another size": (
            {"camera": write_json(tmp / "camera.json", camera)},
            "160×120 but the camera is 320×240",
        ),
        "singular": (pose([[1, 0, 0], [0, 1, 0], [0, 0, 0]], [0, 0, 0.5]), "not a rotation"),
        "left-handed": (pose([[1, 0, 0], [0, 1, 0], [0, 0, -1]], [0, 0, 0.5]), "left-handed"),
        "behind the camera": (pose(EYE, [0, 0, -0.5]), "behind the camera"),
        "out of sight": (pose(EYE, [2, 0, 0.5]), "outside of the image"),
        "millimetres": (pose(EYE, [10, 20, 500]), ".json: the object stands 501 m away; the trans"),
        "a folder for a start": ({"start": str(tmp / "empty")}, "empty is a folder"),
        "text for a start": ({"start": str(tmp / "mesh.xyz")}, "a pose file holds {"),
        "inside the object": (pose(EYE, [-0.03, 0.01, -0.01]), "inside the object"),
        "output is a file": ({"output": str(clip.folder / "camera.json")}, "cannot be made"),
    }


NAMES = [
    "no mesh",
    "mesh without faces",
    "foreign mesh",
    "unit mix-up",
    "no video",
    "empty folder",
    "text for video",
    "no camera",
    "pose for camera",
    "camera of another size",
    "singular",
    "left-handed",
    "behind the camera",
    "out of sight",
    "millimetres",
    "a folder for a start",
    "text for a start",
    "inside the object",
    "output is a file",
]


@pytest.mark.parametrize("name", NAMES)
def test_bad_input_is_one_sentence(clip: Clip, tmp_path: Path, capsys: Any, name: str) -> None:
    changes, words = bad_inputs(clip, tmp_path)[name]
    assert clip.track(**changes) == 2
    lines = capsys.readouterr().err.splitlines()
    assert words in lines[-1] and lines[-1].startswith("moveit6d: ")
    assert not any("Traceback" in line for line in lines)
    assert len(lines) == 1 and not (clip.output / "poses.csv").exists()


def test_every_bad_input_is_tried(clip: Clip, tmp_path: Path) -> None:
    assert sorted(bad_inputs(clip, tmp_path)) == sorted(NAMES)


@pytest.mark.parametrize("kind", ["missing", "damaged", "foreign"])
def test_bad_weights_are_one_sentence(
    make_sequence: Make, tmp_path: Path, capsys: Any, kind: str
) -> None:
    from safetensors.torch import save_file

    made = make_sequence("clip", frames=2)
    path = tmp_path / "w.safetensors"
    if kind == "damaged":
        path.write_bytes(b"\x10\x00\x00\x00\x00\x00\x00\x00 not json")
    if kind == "foreign":
        save_file({"layer.weight": torch.zeros(3)}, path, {"format": "pt"})
    clip = Clip(made.folder, tmp_path / "out", made.poses[0])
    assert clip.track("--weights", str(path)) == 2
    said = capsys.readouterr().err
    assert "w.safetensors" in said and len(said.splitlines()) == 1
    assert not clip.output.exists()


def halve(clip: Clip, *numbers: int) -> None:
    for number in numbers:
        path = clip.folder / "frames" / f"{number:06d}.png"
        Image.open(path).resize((80, 60)).save(path)


def test_a_video_of_another_size_is_said_at_once(clip: Clip, capsys: Any) -> None:
    clip.output.mkdir()
    for name in ("poses.csv", "summary.json", "overlay.mp4"):
        (clip.output / name).write_text("earlier")
    (clip.folder / "frames" / "000000.png").write_bytes(b"\x89PNG broken")
    halve(clip, 1, 2, 3, 4)
    assert clip.track() == 2
    assert capsys.readouterr().err == (
        "moveit6d: 000001.png is 80×60 but the camera is 160×120; give the intrinsics of 80×60 "
        "(if the whole picture was scaled: fx 90, fy 91, cx 38.75, cy 30.25).\n"
    )
    assert {path.read_text() for path in clip.output.iterdir()} == {"earlier"}


def test_a_cut_video_has_no_intrinsics_by_its_size(clip: Clip, capsys: Any) -> None:
    path = clip.folder / "frames" / "000000.png"
    Image.open(path).crop((0, 0, 120, 120)).save(path)
    assert clip.track() == 2
    assert capsys.readouterr().err.endswith("160×120; give the intrinsics of 120×120.\n")


def test_what_comes_live_in_another_size_is_said_at_once(
    clip: Clip, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from moveit6d.datasets import video

    class Live(video.ImageFolder):
        live = True

    halve(clip, 0, 1, 2, 3, 4)
    monkeypatch.setattr(video, "open_frames", lambda source: Live(clip.folder / "frames"))
    assert clip.track(video="0") == 2
    assert "is 80×60 but the camera is 160×120" in capsys.readouterr().err
    assert not clip.output.exists()


def test_a_first_frame_that_cannot_be_calibrated_from_is_said(clip: Clip, capsys: Any) -> None:
    assert clip.track("--no_overlay", "--exact_start") == 0
    assert "--exact_start" not in capsys.readouterr().err
    (clip.folder / "frames" / "000000.png").write_bytes(b"\x89PNG broken")
    assert clip.track("--no_overlay", "--exact_start") == 0
    assert "the first frame cannot be read, so that nothing is cal" in capsys.readouterr().err


def test_an_object_that_looks_larger_than_its_mesh_is_told(
    clip: Clip, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    for size, words in (
        (1.036, "the object looks 3.6 % larger than its mesh"),
        (0.98, "2.0 % smaller than"),
    ):
        monkeypatch.setattr("moveit6d.estimation.tracker.seen_size", lambda *_, k=size: k)
        assert clip.track("--no_overlay", "--exact_start") == 0
        assert words in capsys.readouterr().err
    monkeypatch.setattr("moveit6d.estimation.tracker.seen_size", lambda *_: 1.005)
    assert clip.track("--no_overlay", "--exact_start") == 0
    assert "than its mesh" not in capsys.readouterr().err


def test_its_options_are_the_settings_that_it_reads(make_sequence: Make, tmp_path: Path) -> None:
    made = make_sequence("clip", frames=3)
    with recorded() as read:
        assert Clip(made.folder, tmp_path / "out", made.poses[0]).track("--exact_start") == 0
    assert read - UNWRITTEN <= offered("track")
    unread = {("LoopConfig", "augment"), ("MultiStartConfig", "below"), *UNWRITTEN}
    assert not unread & offered("track")


def test_a_start_may_be_a_matrix(clip: Clip) -> None:
    matrix = clip.folder / "start.txt"
    np.savetxt(matrix, Pose.load(clip.folder / "start.json").matrix.numpy())
    assert clip.track("--no_overlay", start=str(matrix)) == 0
    assert all(row.state == "tracking" for row in read_poses(clip.output / "poses.csv"))
