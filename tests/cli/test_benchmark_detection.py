"""`moveit6d benchmark detection`, `recovery` and `motion`: tables and kept tracks."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from moveit6d import extras
from moveit6d.cli.benchmark_detection import _photos
from moveit6d.cli.main import main
from moveit6d.datasets.pose_files import RESULT_COLUMNS, PoseRow, read_poses, write_poses
from moveit6d.errors import InputError
from moveit6d.estimation import PoseTracker
from moveit6d.estimation.detection import detector
from moveit6d.evaluation import motion_cost
from moveit6d.evaluation.motion_cost import MotionCost
from moveit6d.frame import prepare_frame
from tests.support.configs import FAST_DETECTION


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    folder = tmp_path / "photos"
    folder.mkdir()
    for number in range(3):
        Image.fromarray(np.full((60, 80, 3), 60 * number, np.uint8)).save(folder / f"{number}.png")
    return folder


def table(text: str) -> dict[str, list[str]]:
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines()]
    return {row[0]: row[1:] for row in rows if len(row) > 2 and not row[0].startswith("-")}


def test_detection_counts_frames_and_claims(
    make_sequence: Callable[..., Any], photos: Path, tmp_path: Path, capsys: Any
) -> None:
    made = make_sequence("easy_00", frames=2)
    objects = tmp_path / "objects"
    objects.mkdir()
    (objects / "brick.ply").write_bytes((made.folder / "mesh.ply").read_bytes())
    command = ["benchmark", "detection", "--sequences", str(made.folder.parent), "--every", "3"]
    command += ["--photos", str(photos), "--objects", str(objects), "--limit", "1"]
    assert main([*command, *FAST_DETECTION]) == 0
    found = table(capsys.readouterr().out)
    assert found["easy"][0] == "1", "frame 0"
    assert found["all"][:2] == ["1", "0.0 %"], "the last table: no pose in a photo is right"
    assert main(["benchmark", "detection"]) == 2
    assert "give --sequences" in capsys.readouterr().err


def test_detection_counts_what_cannot_be_read(
    make_sequence: Callable[..., Any], photos: Path, tmp_path: Path, capsys: Any
) -> None:
    made = make_sequence("easy_00", frames=2)
    (made.folder / "frames" / "000001.png").write_bytes(b"no picture")
    command = [
        "benchmark",
        "detection",
        "--sequences",
        str(made.folder),
        "--every",
        "1",
        *FAST_DETECTION,
    ]
    assert main(command) == 0
    said = capsys.readouterr().out
    assert table(said)["all"][0] == "2" and "1 of 2 frames could not be read" in said
    (made.folder / "frames" / "000000.png").write_bytes(b"no picture")
    assert main(command) == 2
    assert "none of the 2 frames to score can be read" in capsys.readouterr().err


def test_detection_without_a_frame_to_look_in_is_one_sentence(
    make_sequence: Callable[..., Any], capsys: Any
) -> None:
    made = make_sequence("easy_00", frames=3, start=False)
    poses = made.folder / "poses.csv"
    head, _, *rows = poses.read_text().splitlines()
    poses.write_text("\n".join([head, *rows]))
    command = ["benchmark", "detection", "--sequences", str(made.folder), "--every", "20"]
    assert main(command) == 2
    assert "a multiple of 20 has a true pose; give a smaller --every" in capsys.readouterr().err


def test_detection_computes_with_as_many_threads_as_asked(
    make_sequence: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    made, used = make_sequence("easy_00", frames=1), []

    def watched(*given: Any) -> Any:
        used.append(torch.get_num_threads())
        return prepare_frame(*given)

    monkeypatch.setattr(detector, "prepare_frame", watched)
    before = torch.get_num_threads()
    command = ["benchmark", "detection", "--sequences", str(made.folder.parent), *FAST_DETECTION]
    try:
        assert main([*command, "--threads", "2"]) == 0
    finally:
        torch.set_num_threads(before)
    assert used and set(used) == {2}


def test_recovery_keeps_the_tracks(
    make_sequence: Callable[..., Any], scene: Any, use_oracle: Callable[..., None], photos: Path,
    tmp_path: Path, capsys: Any,
) -> None:  # fmt: skip
    made = make_sequence("hard_01", frames=4, still=True)
    use_oracle(scene.mesh, made.poses[0])
    command = ["benchmark", "recovery", "--sequences", str(made.folder.parent)]
    command += ["--photos", str(photos), "--output", str(tmp_path / "tracks")]
    assert main(command) == 0
    found = table(capsys.readouterr().out)
    assert {"hard_01", "hard", "all"} <= set(found)
    assert found["all"] == ["–", "–", "0.0 %", "100.0 %"], "it never went away"
    rows = read_poses(tmp_path / "tracks" / "hard_01.csv")
    assert [row.frame for row in rows] == [0, 1, 2, 3]


@pytest.fixture
def calibrated(monkeypatch: pytest.MonkeyPatch) -> list[Any]:
    """The images from which trackers calibrated."""
    seen: list[Any] = []
    monkeypatch.setattr(PoseTracker, "calibrate", lambda self, image: seen.append(image))
    return seen


@pytest.mark.parametrize(("options", "number"), [([], 1), (["--no_calibration"], 0)])
def test_recovery_calibrates_unless_told_not_to(
    make_sequence: Callable[..., Any], scene: Any, use_oracle: Callable[..., None], photos: Path,
    tmp_path: Path, calibrated: list[Any], options: list[str], number: int,
) -> None:  # fmt: skip
    made = make_sequence("hard_01", frames=2, still=True)
    use_oracle(scene.mesh, made.poses[0])
    command = ["benchmark", "recovery", "--sequences", str(made.folder.parent)]
    command += ["--photos", str(photos), "--output", str(tmp_path / "tracks")]
    assert main([*command, *options]) == 0
    assert len(calibrated) == number


def test_recovery_begins_in_the_frame_of_the_start(
    make_sequence: Callable[..., Any], scene: Any, use_oracle: Callable[..., None], photos: Path,
    tmp_path: Path, calibrated: list[Any],
) -> None:  # fmt: skip
    made = make_sequence("hard_01", frames=5, start=False)
    table = made.folder / "poses.csv"
    head, *rows = table.read_text().splitlines()
    table.write_text("\n".join([head, *rows[3:]]))
    use_oracle(scene.mesh, made.poses[3])
    command = ["benchmark", "recovery", "--sequences", str(made.folder.parent)]
    command += ["--photos", str(photos), "--output", str(tmp_path / "tracks")]
    assert main(command) == 0
    kept = read_poses(tmp_path / "tracks" / "hard_01.csv")
    assert [row.frame for row in kept] == [3, 4]
    (image,) = calibrated
    np.testing.assert_array_equal(image, scene.image(3))


def test_recovery_without_the_frame_of_the_start_is_one_sentence(
    make_sequence: Callable[..., Any], scene: Any, use_oracle: Callable[..., None], photos: Path,
    tmp_path: Path, capsys: Any,
) -> None:  # fmt: skip
    made = make_sequence("hard_01", frames=2, start=False)
    write_poses(made.folder / "poses.csv", [PoseRow(9, pose=made.poses[0])], RESULT_COLUMNS)
    use_oracle(scene.mesh, made.poses[0])
    command = ["benchmark", "recovery", "--sequences", str(made.folder.parent)]
    command += ["--photos", str(photos), "--output", str(tmp_path / "tracks")]
    assert main(command) == 2
    assert "hard_01: there is no frame 9, that of the start" in capsys.readouterr().err


def test_motion_refuses_speeds_that_cannot_be(capsys: Any) -> None:
    for speed in ("-1", "nan", "inf", "1e6"):
        assert main(["benchmark", "motion", "--speeds", speed]) == 2
    assert main(["benchmark", "motion", "--frames", "1"]) == 2
    assert capsys.readouterr().err.count("--frames must be 2 or more") == 5


def test_motion_draws_its_table(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    costs = [MotionCost(5.0, 1.5, 20.0, 0.5), MotionCost(0.0, 1.0, 12.0, 1.0)]
    monkeypatch.setattr(motion_cost, "motion_costs", lambda *args: iter(costs))
    name = tmp_path / "motion.v2"
    assert main(["benchmark", "motion", "--speeds", "5", "0", "--chart", str(name)]) == 0
    assert sorted(path.name for path in tmp_path.iterdir()) == ["motion.v2.png", "motion.v2.svg"]
    assert capsys.readouterr().out.endswith(f"{name}.png, {name}.svg\n")


def test_a_chart_of_motion_takes_no_input_s_place(tmp_path: Path, capsys: Any) -> None:
    config = tmp_path / "mesh.svg"
    config.write_text("{}")
    given = ["--config", str(config), "--chart", str(tmp_path / "mesh")]
    assert main(["benchmark", "motion", *given]) == 2
    assert "--chart" in capsys.readouterr().err and config.read_text() == "{}"


def test_a_chart_without_matplotlib_is_refused_before_the_work(
    monkeypatch: pytest.MonkeyPatch, capsys: Any, tmp_path: Path
) -> None:
    monkeypatch.setattr(extras, "find_spec", lambda name: None)
    assert main(["benchmark", "motion", "--chart", str(tmp_path / "chart")]) == 2
    assert "pip install 'moveit6d[report]'" in capsys.readouterr().err


def test_photos_are_chosen_evenly(photos: Path) -> None:
    assert [name for name, _ in _photos(photos, 2)] == ["0.png", "2.png"]
    assert [name for name, _ in _photos(photos, 1)] == ["0.png"]
    assert len(_photos(photos, None)) == len(_photos(photos, 9)) == 3


def test_photos_that_are_left_out_are_said(photos: Path, capsys: Any) -> None:
    (photos / "1.png").write_bytes(b"no picture")
    assert [name for name, _ in _photos(photos, None)] == ["0.png", "2.png"]
    assert "1 of 3 pictures cannot be read" in capsys.readouterr().err


def test_photos_that_cannot_be_read_are_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "0.png").write_bytes(b"no picture")
    with pytest.raises(InputError, match="no picture can be read"):
        _photos(tmp_path, None)
