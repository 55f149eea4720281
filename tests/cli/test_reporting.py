"""Reports and logs of a track: written, after Ctrl-C too, and refused where they cannot be."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from moveit6d.cli.reporting import check_report, reporting, verdict
from moveit6d.datasets.video import VideoFrame
from moveit6d.errors import InputError
from moveit6d.evaluation.track_scores import Score
from moveit6d.rendering.backends import make_renderer
from tests.support.clip import Clip

Make = Callable[..., Any]


def test_a_report_is_written_and_after_ctrl_c_too(
    clip: Clip, tmp_path: Path, interrupt_update: Callable[[int], None]
) -> None:
    (clip.folder / "frames" / "000001.png").write_bytes(b"\x89PNG broken")
    page = tmp_path / "page" / "report.html"
    assert clip.track("--no_overlay", "--report", str(page)) == 0
    text = page.read_text()
    assert "5 frames, 1 without a pose" in text and "not a readable image" in text
    assert text.count(' data-rank="') == 5 and text.count("data:image/jpeg") == 10

    interrupt_update(4)
    assert clip.track("--no_overlay", "--report", str(page)) == 130
    assert "3 frames, 1 without a pose" in page.read_text()


def test_a_report_goes_by_the_confidence_that_the_track_goes_by(
    clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[float] = []
    monkeypatch.setattr(
        "moveit6d.visualization.report.curves_svg", lambda _, low: seen.append(low) or ""
    )
    page = tmp_path / "report.html"
    assert clip.track("--no_overlay", "--report", str(page), "--low_confidence", "0.3") == 0
    assert seen == [0.3]


def test_without_a_report_nothing_is_kept(scene: Any) -> None:
    frames = Stream(live=True)
    with reporting(None, {}, scene.mesh, scene.camera, frames, make_renderer(), 0.5) as page:
        assert page is None


@pytest.mark.filterwarnings("ignore")
def test_a_log_for_rerun_is_written(clip: Clip, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    assert clip.track("--no_overlay", "--rerun", str(tmp_path / "run.rrd")) == 0
    assert (tmp_path / "run.rrd").stat().st_size > 10_000


def test_a_camera_allows_no_report(
    clip: Clip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    from moveit6d.datasets import video

    camera = video.LiveCamera.__new__(video.LiveCamera)
    monkeypatch.setattr(video, "open_frames", lambda source: camera)
    assert clip.track("--report", str(tmp_path / "report.html"), video="0") == 2
    assert "record it first" in capsys.readouterr().err


class Stream:
    """Frames that come by themselves, as `NetworkVideo` has them."""

    length = fps = None

    def __init__(self, live: bool) -> None:
        self.live = live

    def __iter__(self) -> Iterator[VideoFrame]:
        return iter(())


def test_what_can_be_seen_only_once_has_no_report(tmp_path: Path) -> None:
    check_report(tmp_path / "page.html", Stream(live=False))
    check_report(None, Stream(live=True))
    with pytest.raises(InputError, match="reads the video a second time"):
        check_report(tmp_path / "page.html", Stream(live=True))


def test_what_a_log_needs_is_said_before_the_track(
    clip: Clip, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    clip.output.mkdir()
    (clip.output / "summary.json").write_text(json.dumps({"arguments": {"report": "r.html"}}))
    for name in ("poses.csv", "r.html", "overlay.mp4"):
        (clip.output / name).write_text("earlier")
    monkeypatch.setattr("moveit6d.extras.find_spec", lambda name: None)
    assert clip.track("--rerun", str(clip.output / "x.rrd")) == 2
    assert "--rerun needs rerun: pip install" in capsys.readouterr().err
    assert len(list(clip.output.iterdir())) == 4, "the earlier track stays"


def test_the_runs_own_files_stay(clip: Clip, capsys: Any) -> None:
    clip.output.mkdir()
    (clip.output / "poses.csv").write_text("earlier")
    inputs = ("mesh.ply", "camera.json", "start.json", "frames", "frames/000002.png")

    def written() -> dict[str, tuple[int, int]]:  # not when it was read last, which changes
        found = {name: (clip.folder / name).stat() for name in inputs}
        return {name: (stat.st_ino, stat.st_mtime_ns) for name, stat in found.items()}

    before = written()
    for path in (clip.output / "poses.csv", *(clip.folder / name for name in inputs)):
        for option in ("--report", "--rerun"):
            assert clip.track(option, str(path)) == 2
            assert f"{option}: {path} would be replaced" in capsys.readouterr().err
    assert (clip.output / "poses.csv").read_text() == "earlier"
    assert before == written()


def test_a_verdict_names_the_frame_of_the_loss() -> None:
    lost = Score(20, 0.5, 0.5, 0.1, 0.1, 10, 0.5, 0, None, 0, lost_at=145)
    assert "lost at frame 145" in verdict(lost)
    assert "never lost" in verdict(replace(lost, until_lost=21, lost_at=None))
