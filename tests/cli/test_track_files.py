"""The files beside the table: the picture of the start, and one page and log for each object."""

from __future__ import annotations

import csv
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from moveit6d import Pose
from moveit6d.cli.main import main
from moveit6d.cli.track_files import files_of
from moveit6d.datasets.pose_files import whole_lines
from moveit6d.estimation import PoseTracker
from tests.support.clip import Clip, write_other


def test_of_several_objects_files_have_their_names() -> None:
    page = Path("out/report.html")
    assert files_of(page, [""]) == [page] and files_of(None, ["a", "b"]) == [None, None]
    assert files_of(page, ["cup", "can"]) == [
        Path("out/report_cup.html"), Path("out/report_can.html"),
    ]  # fmt: skip


def test_the_start_is_drawn_on_the_first_frame(clip: Clip) -> None:
    assert clip.track() == 0
    picture = np.asarray(Image.open(clip.output / "start.png")).astype(int)
    frame = np.asarray(Image.open(clip.folder / "frames" / "000000.png")).astype(int)
    assert picture.shape == frame.shape and clip.summary()["start_picture"] == "start.png"
    changed = np.abs(picture - frame).sum(-1) > 60
    assert 100 < changed.sum() < 0.4 * changed.size
    assert clip.track("--no_overlay") == 0
    assert not (clip.output / "start.png").exists(), "of the track that is replaced"
    (clip.output / "start.png").write_bytes(b"another program's")
    assert clip.track("--no_overlay") == 0
    assert (clip.output / "start.png").exists()


def test_without_a_start_the_first_pose_found_is_drawn(
    clip: Clip, use_search: Callable[[Pose | None], Any]
) -> None:
    use_search(clip.true)
    (clip.folder / "frames" / "000000.png").write_bytes(b"no picture")
    assert clip.search("--box", "50", "40", "40", "40", "--distance", "0.2", "1") == 0
    assert (clip.output / "start.png").is_file()


def test_no_picture_is_put_among_the_frames(clip: Clip, capsys: Any) -> None:
    frames = clip.folder / "frames"
    assert clip.track(output=str(frames)) == 0
    assert "start.png is left out: in " in capsys.readouterr().err
    assert not (frames / "start.png").exists()


@pytest.fixture
def two(clip: Clip, scene: Any, use_oracle: Callable[..., None]) -> Callable[..., int]:
    """Tracks the clip's object and another one; both stand where it is."""
    use_oracle(scene.mesh, clip.true, targets=2)
    write_other(clip.folder)
    start = str(clip.folder / "start.json")

    def track(*more: str) -> int:
        return clip.search(
            "--mesh", str(clip.folder / "other.ply"), "--start", start, "--start", start,
            "--no_overlay", *more,
        )  # fmt: skip

    return track


def test_several_objects_have_a_page_each(two: Callable[..., int], clip: Clip) -> None:
    assert two("--report", str(clip.output / "page.html")) == 0
    assert sorted(path.name for path in clip.output.glob("*.html")) == [
        "page_mesh.html", "page_other.html",
    ]  # fmt: skip
    text = (clip.output / "page_other.html").read_text()
    assert "other" in text and "5 frames, 0 without a pose" in text and "other.ply" in text


@pytest.mark.filterwarnings("ignore")
def test_several_objects_have_a_log_each(two: Callable[..., int], clip: Clip) -> None:
    pytest.importorskip("rerun")
    assert two("--rerun", str(clip.folder / "run.rrd")) == 0
    for name in ("run_mesh.rrd", "run_other.rrd"):
        assert (clip.folder / name).stat().st_size > 10_000


@pytest.mark.parametrize("torn", [False, True])
def test_several_objects_are_gone_on_with(
    two: Callable[..., int], clip: Clip, interrupt_update: Callable[[int], None],
    monkeypatch: pytest.MonkeyPatch, torn: bool,
) -> None:  # fmt: skip
    (clip.folder / "frames" / "000001.png").write_bytes(b"no picture")
    assert two() == 0
    whole = list(csv.reader((clip.output / "poses.csv").read_text().splitlines()))
    interrupt_update(4)
    assert two() == 130
    monkeypatch.undo()
    table = clip.output / "poses.csv"
    if torn:  # killed between the two rows of a frame
        lines = whole_lines(table).splitlines(keepends=True)
        assert len(lines) == 7
        table.write_text("".join(lines[:6]))
    followed: list[int] = []
    update = PoseTracker.update

    def watched(self: Any, image: Any) -> Any:
        followed.append(1)
        return update(self, image)

    monkeypatch.setattr(PoseTracker, "update", watched)
    page = clip.folder / "page.html"
    assert two("--resume", "--report", str(page)) == 0
    assert len(followed) == (3 if torn else 2)
    rows = list(csv.reader(table.read_text().splitlines()))
    kept = [0, 1, -2, -1]  # frame, image, object and state
    assert [[row[k] for k in kept] for row in rows] == [[row[k] for k in kept] for row in whole]
    objects = clip.summary()["objects"]
    for name in ("mesh", "other"):
        assert objects[name]["frames"] == 5 and objects[name]["failed"] == 1
        assert "not a readable image" in objects[name]["failures"][0]["error"]
        assert "5 frames, 1 without a pose" in (clip.folder / f"page_{name}.html").read_text()
    assert two("--resume") == 0, "nothing is left to do"
    assert len(followed) == (3 if torn else 2)


def test_another_start_of_one_of_them_is_another_track(
    two: Callable[..., int], clip: Clip, interrupt_update: Callable[[int], None], capsys: Any
) -> None:
    interrupt_update(3)
    assert two() == 130
    (clip.folder / "moved.json").write_text((clip.folder / "start.json").read_text() + " ")
    capsys.readouterr()
    assert main([
        "track", "--mesh", str(clip.folder / "mesh.ply"), "--mesh", str(clip.folder / "other.ply"),
        "--mesh_unit", "m", "--video", str(clip.folder / "frames"), "--camera",
        str(clip.folder / "camera.json"), "--output", str(clip.output), "--no_overlay",
        "--start", str(clip.folder / "start.json"), "--start", "none", "--resume",
    ]) == 2  # fmt: skip
    assert "holds a track with another --start;" in capsys.readouterr().err
