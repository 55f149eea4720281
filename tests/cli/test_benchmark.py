"""`moveit6d benchmark` and `moveit6d evaluate`: tables beside rivals, tracks, videos, times."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from moveit6d.cli.main import main
from moveit6d.datasets.files import PoseRow, read_poses, write_poses
from moveit6d.estimation import PoseTracker

Make = Callable[..., Any]


@pytest.fixture
def sequences(make_sequence: Make, scene: Any, use_oracle: Callable[..., None]) -> Path:
    """Two still sequences, and a policy that knows their pose."""
    for name in ("easy_00", "hard_01"):
        made = make_sequence(name, frames=4, still=True)
    use_oracle(scene.mesh, made.poses[0])
    folder: Path = made.folder.parent
    return folder


@pytest.fixture
def rivals(tmp_path: Path, sequences: Path) -> Path:
    """One rival that has lost hard_01 from its second frame on, and knows easy_00."""
    truth = read_poses(sequences / "easy_00" / "poses.csv")
    write_poses(tmp_path / "rivals" / "other" / "easy_00.csv", truth)
    lost = [*truth[:2], *(PoseRow(row.frame) for row in truth[2:])]
    write_poses(tmp_path / "rivals" / "other" / "hard_01.csv", lost)
    return tmp_path / "rivals"


def table(text: str) -> list[list[str]]:
    """The cells of the Markdown tables in a text."""
    lines = [line for line in text.splitlines() if line.startswith("|") and "---" not in line]
    return [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]


def test_our_row_stands_under_the_rivals(
    sequences: Path, rivals: Path, tmp_path: Path, capsys: Any
) -> None:
    out = tmp_path / "ours"
    options = ["--rivals", str(rivals), "--output", str(out), "--overlays", "--per_sequence"]
    command = ["benchmark", "tracking", "--sequences", str(sequences), *options, "--name", "me"]
    assert main(command) == 0
    rows = table(capsys.readouterr().out)
    assert [row[:2] for row in rows[1:7]] == [
        ["easy", "other"], ["easy", "me"], ["hard", "other"],
        ["hard", "me"], ["all", "other"], ["all", "me"],
    ]  # fmt: skip
    assert rows[3][3] == "33.3 %" and rows[4][3] == "100.0 %" and rows[6][3] == "100.0 %"
    assert [row[0] for row in rows[8:]] == ["easy", "easy_00", "hard", "hard_01", "all"]
    assert sorted(p.name for p in out.iterdir()) == [
        "easy_00.csv", "easy_00.mp4", "hard_01.csv", "hard_01.mp4",
    ]  # fmt: skip
    written = read_poses(out / "hard_01.csv")
    assert len(written) == 4 and written[0].milliseconds is None and written[1].milliseconds


def test_results_are_scored_again_by_evaluate(sequences: Path, rivals: Path, capsys: Any) -> None:
    assert main(["evaluate", "tracking", "--sequences", str(sequences),
                 "--results", str(rivals / "other")]) == 0  # fmt: skip
    rows = table(capsys.readouterr().out)
    assert [(row[0], row[2], row[6]) for row in rows[1:]] == [
        ("easy", "100.0 %", "4"),
        ("hard", "33.3 %", "2"),
        ("all", "66.7 %", "3"),
    ]


def test_missing_results_are_said(sequences: Path, rivals: Path, capsys: Any) -> None:
    (rivals / "other" / "hard_01.csv").unlink()
    command = ["evaluate", "tracking", "--sequences", str(sequences), "--results"]
    assert main([*command, str(rivals / "other")]) == 0
    assert "no result for hard_01" in capsys.readouterr().err
    assert main([*command, str(rivals)]) == 2
    assert "holds no <sequence>.csv" in capsys.readouterr().err


def test_only_some_sequences(sequences: Path, capsys: Any) -> None:
    command = ["benchmark", "tracking", "--sequences", str(sequences), "--only"]
    assert main([*command, "hard_01"]) == 0
    assert [row[0] for row in table(capsys.readouterr().out)] == ["level", "hard"]
    assert main([*command, "hard_07"]) == 2
    assert "has no sequence hard_07" in capsys.readouterr().err


def test_every_sequence_gets_a_fresh_tracker(
    sequences: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[PoseTracker] = []
    frames: list[int] = []
    init, update = PoseTracker.__init__, PoseTracker.update

    def record_init(self: PoseTracker, *args: Any, **options: Any) -> None:
        init(self, *args, **options)
        made.append(self)

    def record_update(self: PoseTracker, image: Any) -> Any:
        frames.append(made.index(self))
        return update(self, image)

    monkeypatch.setattr(PoseTracker, "__init__", record_init)
    monkeypatch.setattr(PoseTracker, "update", record_update)
    assert main(["benchmark", "tracking", "--sequences", str(sequences)]) == 0
    assert frames == [0, 0, 0, 1, 1, 1]


def test_ctrl_c_prints_what_was_done(
    sequences: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    update, calls = PoseTracker.update, iter(range(99))

    def stop_at_fifth(self: PoseTracker, image: Any) -> Any:
        if next(calls) == 4:
            raise KeyboardInterrupt
        return update(self, image)

    monkeypatch.setattr(PoseTracker, "update", stop_at_fifth)
    out = tmp_path / "ours"
    assert main(["benchmark", "tracking", "--sequences", str(sequences),
                 "--output", str(out)]) == 130  # fmt: skip
    assert [row[0] for row in table(capsys.readouterr().out)] == ["level", "easy"]
    assert len(read_poses(out / "hard_01.csv")) == 2


def test_overlays_need_a_place(sequences: Path, capsys: Any) -> None:
    assert main(["benchmark", "tracking", "--sequences", str(sequences), "--overlays"]) == 2
    assert "--overlays needs --output" in capsys.readouterr().err


def test_the_parts_of_a_cycle_are_printed(sequences: Path, brick_file: Path, capsys: Any) -> None:
    assert main(["benchmark", "cycle", "--mesh", str(brick_file), "--repeats", "2",
                 "--threads", "1"]) == 0  # fmt: skip
    text = capsys.readouterr().out
    for part in ("crop", "render", "observe", "network", "move", "sum", "whole cycle"):
        assert part in text
    assert "1 threads" in text and "median of 2" in text
