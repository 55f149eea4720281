"""What `moveit6d track` says of a track in which nothing was found, or that ended at once."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from moveit6d import Pose
from moveit6d.cli.main import main
from moveit6d.cli.track_summary import verdict
from moveit6d.datasets.pose_files import PoseRow
from moveit6d.evaluation.run_tracker import TrackSummary
from tests.support.clip import Clip


@pytest.fixture
def lost(make_sequence: Callable[..., Any], tmp_path: Path) -> list[str]:
    """A track of frames in which the object is not, without a start."""
    folder = make_sequence("clip", frames=4).folder
    noise = np.random.default_rng(0).integers(0, 255, (12, 16, 3), np.uint8)
    for path in (folder / "frames").iterdir():
        Image.fromarray(noise.repeat(10, 0).repeat(10, 1)).save(path)
    return [
        "track", "--mesh", str(folder / "mesh.ply"), "--mesh_unit", "m", "--video",
        str(folder / "frames"), "--camera", str(folder / "camera.json"), "--output",
        str(tmp_path / "out"), "--no_overlay", "--recovery.first_interval", "9",
        "--recovery.interval", "9", "--detection.match.more_places", "0",
    ]  # fmt: skip


def test_an_object_that_is_never_found_is_exit_code_3(
    lost: list[str], tmp_path: Path, capsys: Any
) -> None:
    for more in ([], ["--resume"]):
        assert main([*lost, *more]) == 3
        said = capsys.readouterr().err.splitlines()[-1]
        assert "frames: the object was not found in any of 4 frames; narrow the search" in said
        assert "by --box or --mask or --points or --distance or --start." in said
        text = (tmp_path / "out" / "summary.json").read_text()
        assert '"failed": 4' in text and '"lost_from_frame": 0' in text
        assert '"error"' not in text, "the events say it"


def test_one_of_several_objects_that_is_never_found_is_said(capsys: Any) -> None:
    seen, unseen = TrackSummary(), TrackSummary()
    for frame in range(3):
        pose = Pose.from_rvec([0, 0, 0], [0, 0, 1])
        seen.add_row(PoseRow(frame, "", pose, confidence=0.9, milliseconds=9.0))
        unseen.add_row(PoseRow(frame, "", confidence=0.1, milliseconds=9.0, state="lost"))
    args = Namespace(
        video="clip.mp4", mesh=["cup.glb", "can.glb"], start=[Path("cup.json"), None],
        distance=None, box=None, mask=None, points=None, output="out",
    )  # fmt: skip
    assert verdict(args, [seen, unseen], ["cup", "can"]) == 0
    (said,) = capsys.readouterr().err.splitlines()
    assert "clip.mp4: can was not found in any of 3 frames; narrow the search by" in said
    assert said.endswith("by --distance or --start.")


@pytest.mark.parametrize("more", [[], ["--resume"]])
def test_frames_none_of_which_can_be_read_are_bad_input(
    clip: Clip, capsys: Any, more: list[str]
) -> None:
    for path in (clip.folder / "frames").iterdir():
        path.write_bytes(b"\x89PNG broken")
    assert clip.track("--no_overlay") == 2
    assert clip.track("--no_overlay", *more) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert "no frame could be tracked; the first says: " in said and "not a readable image" in said


def test_a_track_that_ends_before_its_first_frame_leaves_an_earlier_one(
    clip: Clip, interrupt_update: Callable[[int], None]
) -> None:
    page = str(clip.output / "r.html")
    assert clip.track("--report", page) == 0
    before = {path: path.read_bytes() for path in clip.output.iterdir()}
    assert len(before) == 5
    interrupt_update(1)
    assert clip.track("--report", page) == 130
    assert {path: path.read_bytes() for path in clip.output.iterdir()} == before


def test_an_interrupted_track_can_still_be_gone_on_with(
    clip: Clip, interrupt_update: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    from moveit6d.cli.journal import journal_file

    journal = journal_file(clip.output / "poses.csv")
    with monkeypatch.context():
        monkeypatch.setattr("moveit6d.cli.journal.Journal.finish", lambda self: None)
        interrupt_update(3)
        assert clip.track("--no_overlay") == 130
        (clip.output / "summary.json").unlink()  # as a killed track leaves it
        interrupt_update(1)
        assert clip.track("--no_overlay", "--no_contour") == 130
        assert journal.is_file()
    monkeypatch.undo()
    assert clip.track("--no_overlay", "--resume") == 0
