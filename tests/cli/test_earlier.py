"""Results of an earlier run in the folder of a new one."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from moveit6d.cli.earlier import clear_detection, clear_earlier, holds_results


def earlier(folder: Path, **arguments: object) -> None:
    folder.mkdir(exist_ok=True)
    (folder / "summary.json").write_text(json.dumps({"arguments": arguments}))
    for name in (
        "poses.csv",
        "overlay.mp4",
        "overlay_000012.mp4",
        "report.html",
        "mine.txt",
        "run.rrd",
    ):
        (folder / name).write_text("earlier")


def test_what_nothing_replaces_is_removed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    outside = tmp_path / "elsewhere.html"
    outside.write_text("earlier")
    earlier(folder, report=str(folder / "report.html"), rerun=str(outside))
    clear_earlier(folder, [folder / "poses.csv", None])
    left = {path.name for path in folder.iterdir()}
    assert left == {"poses.csv", "mine.txt", "run.rrd"} and outside.exists()
    said = capsys.readouterr().err
    assert (
        "earlier track" in said and "removed: overlay.mp4, overlay_000012.mp4, report.html" in said
    )


def test_pages_of_several_objects_and_the_start_picture_go_too(tmp_path: Path) -> None:
    facts = {
        "arguments": {"report": str(tmp_path / "page.html"), "rerun": str(tmp_path / "log.rrd")},
        "objects": {"cup": {}, "can": {}, "../up": {}},
        "start_picture": "start.png",
    }
    (tmp_path / "summary.json").write_text(json.dumps(facts))
    gone = {"page_cup.html", "page_can.html", "log_cup.rrd", "log_can_000012.rrd", "start.png"}
    stay = {"page.html", "page_bowl.html", "cup.png"}
    for name in gone | stay:
        (tmp_path / name).write_text("earlier")
    clear_earlier(tmp_path, ())
    assert {path.name for path in tmp_path.iterdir()} == stay
    (tmp_path / "summary.json").write_text('{"arguments": {}, "start_picture": "cup.png"}')
    clear_earlier(tmp_path, ())
    assert {path.name for path in tmp_path.iterdir()} == stay, "no file that a track writes"


def test_files_of_a_track_that_was_gone_on_with_go_with_it(tmp_path: Path) -> None:
    earlier(tmp_path, rerun=str(tmp_path / "run.rrd"))
    for name in ("run_000012.rrd", "run_2_copy.rrd", "other_000012.rrd"):
        (tmp_path / name).write_text("earlier")
    clear_earlier(tmp_path, [tmp_path / "overlay.mp4", tmp_path / "run.rrd"])
    left = {path.name for path in tmp_path.iterdir()}
    assert "run_000012.rrd" not in left and "overlay_000012.mp4" not in left
    assert {"run.rrd", "run_2_copy.rrd", "other_000012.rrd", "overlay.mp4"} <= left


def test_what_is_written_anew_stays_until_then(tmp_path: Path) -> None:
    earlier(tmp_path, report=str(tmp_path / "report.html"))
    clear_earlier(tmp_path, [tmp_path / "overlay.mp4", tmp_path / "report.html"])
    assert (tmp_path / "overlay.mp4").exists() and (tmp_path / "report.html").exists()
    assert not (tmp_path / "summary.json").exists(), "it would vouch for half of a new track"


@pytest.mark.parametrize("summary", ["", "[]", '{"arguments": 3}', '{"arguments": {"report": 1}}'])
def test_a_foreign_summary_harms_nothing(tmp_path: Path, summary: str) -> None:
    (tmp_path / "summary.json").write_text(summary)
    (tmp_path / "report.html").write_text("mine")
    clear_earlier(tmp_path, [])
    assert (tmp_path / "report.html").exists()


def test_what_an_interrupted_track_could_go_on_with_goes_too(tmp_path: Path) -> None:
    (tmp_path / "poses.csv.unfinished").write_text("{}")
    clear_earlier(tmp_path, [])
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("name", "content", "ours"),
    [
        ("summary.json", '{"arguments": {}}', True),
        ("detection.json", '{"arguments": {}}', True),
        ("poses.csv.unfinished", "{}", True),
        ("summary.json", "{}", False),
        ("detection.json", "[]", False),
        ("poses.csv", "frame", False),
    ],
)
def test_results_are_known_by_what_vouches_for_them(
    tmp_path: Path, name: str, content: str, ours: bool
) -> None:
    (tmp_path / name).write_text(content)
    assert holds_results(tmp_path) == ours


def test_of_a_detection_the_files_go_that_it_names(tmp_path: Path) -> None:
    (tmp_path / "overlay").mkdir()
    gone = ["poses.csv", "detection.json", "pose.json", "pose_2.json", "pose_cup.json"]
    gone.append("overlay/a.png.png")
    for name in (*gone, "pose_3.json", "overlay/b.png", "camera.json"):
        (tmp_path / name).write_text("earlier")
    facts = {"files": [*gone, "camera.json", "../overlay.png", "pose_4.json", 3]}
    (tmp_path / "detection.json").write_text(json.dumps(facts))
    clear_detection(tmp_path)
    left = {path.name for path in tmp_path.rglob("*")}
    assert left == {"overlay", "pose_3.json", "b.png", "camera.json"}
    clear_detection(tmp_path)


def test_an_empty_folder_says_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "overlay.mp4").write_text("somebody's")
    clear_earlier(tmp_path, [])
    assert (tmp_path / "overlay.mp4").exists() and capsys.readouterr().err == ""
