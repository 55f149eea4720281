"""`moveit6d benchmark tracking`: tables beside rivals, reports, resumed runs."""

from __future__ import annotations

import signal
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from moveit6d.cli.benchmark_tracking import Bench, chosen, make_job
from moveit6d.cli.common import Setting
from moveit6d.cli.main import main, make_parser
from moveit6d.cli.signals import Terminated
from moveit6d.datasets.pose_files import PoseRow, read_poses, write_poses
from moveit6d.estimation import PoseTracker
from moveit6d.geometry.pose import Pose

Make = Callable[..., Any]


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
        ["easy", "other"],
        ["easy", "me"],
        ["hard", "other"],
        ["hard", "me"],
        ["all", "other"],
        ["all", "me"],
    ]
    assert rows[3][3] == "33.3 %" and rows[4][3] == "100.0 %" and rows[6][3] == "100.0 %"
    assert [row[0] for row in rows[8:]] == ["easy", "easy_00", "hard", "hard_01", "all"]
    assert sorted(p.name for p in out.iterdir()) == [
        "easy_00.csv",
        "easy_00.json",
        "easy_00.mp4",
        "hard_01.csv",
        "hard_01.json",
        "hard_01.mp4",
    ]
    written = read_poses(out / "hard_01.csv")
    assert len(written) == 4 and written[0].milliseconds is None and written[1].milliseconds


def test_results_are_scored_again_by_evaluate(sequences: Path, rivals: Path, capsys: Any) -> None:
    assert (
        main(
            [
                "evaluate",
                "tracking",
                "--sequences",
                str(sequences),
                "--results",
                str(rivals / "other"),
            ]
        )
        == 0
    )
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
    sequences: Path, tmp_path: Path, interrupt_update: Callable[[int], None], capsys: Any
) -> None:
    interrupt_update(5)
    out = tmp_path / "ours"
    assert (
        main(["benchmark", "tracking", "--sequences", str(sequences), "--output", str(out)]) == 130
    )
    assert [row[0] for row in table(capsys.readouterr().out)] == ["level", "easy"]
    assert len(read_poses(out / "hard_01.csv")) == 2
    assert not (out / "hard_01.json").exists(), "half a track is not marked as whole"


@pytest.mark.parametrize("option", ["--overlays", "--resume"])
def test_some_options_need_a_place(sequences: Path, capsys: Any, option: str) -> None:
    assert main(["benchmark", "tracking", "--sequences", str(sequences), option]) == 2
    assert f"{option} needs --output" in capsys.readouterr().err


def count_updates(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    calls: list[int] = []
    update = PoseTracker.update

    def record(self: PoseTracker, image: Any) -> Any:
        calls.append(1)
        return update(self, image)

    monkeypatch.setattr(PoseTracker, "update", record)
    return calls


def test_resuming_does_only_what_is_not_done_the_same_way(
    sequences: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    out, report = tmp_path / "ours", tmp_path / "report"
    command = ["benchmark", "tracking", "--sequences", str(sequences), "--output", str(out)]
    assert main(command) == 0
    first = capsys.readouterr().out
    (out / "hard_01.json").unlink()  # as if it had been killed there
    calls = count_updates(monkeypatch)
    again = [*command, "--resume", "--report", str(report)]
    assert main(again) == 0
    assert len(calls) == 3 and capsys.readouterr().out.count("100.0 %") == first.count("100.0 %")
    # Pages are made of finished tracks, too.
    names = sorted(path.name for path in report.iterdir())
    assert names == ["easy_00.html", "hard_01.html", "index.html"]
    assert main(again) == 0 and len(calls) == 3
    assert main([*again, "--max_iterations", "1"]) == 0 and len(calls) == 9
    assert main([*again, "--float32"]) == 0 and len(calls) == 15
    picture = sequences / "hard_01" / "frames" / "000000.png"
    picture.write_bytes(picture.read_bytes() + b"more")
    assert main([*again, "--float32"]) == 0 and len(calls) == 18, "of other images"


def test_workers_write_where_the_command_stands(
    sequences: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    words = ["--sequences", str(sequences), "--output", "out", "--overlays", "--rerun", "logs"]
    args = make_parser().parse_args(["benchmark", "tracking", *words, "--ray", "auto"])
    job = make_job(chosen(args)[0], args, Setting.of(args))
    assert job.movie == tmp_path.resolve() / "out" / "easy_00.mp4"
    assert job.log == tmp_path.resolve() / "logs" / "easy_00.rrd"


def test_reports_lead_from_the_worst_sequence_to_its_worst_frame(
    sequences: Path, tmp_path: Path, make_sequence: Make
) -> None:
    make_sequence("moving_00", frames=4)  # the oracle believes that it stands still
    report = tmp_path / "report"
    command = ["benchmark", "tracking", "--sequences", str(sequences), "--report", str(report)]
    assert main(command) == 0
    index = (report / "index.html").read_text()
    places = [index.index(f'href="{name}.html"') for name in ("moving_00", "easy_00", "hard_01")]
    assert places == sorted(places)
    page = (report / "moving_00.html").read_text()
    assert page.index('data-frame="3"') < page.index('data-frame="1"') < page.index('"f0"')


def test_a_protocol_of_resets_is_kept_and_its_frames_are_not_scored(
    make_sequence: Make, scene: Any, use_oracle: Callable[..., None], tmp_path: Path, capsys: Any
) -> None:
    made = make_sequence("easy_00", frames=20)
    use_oracle(scene.mesh, made.poses[0])
    out = tmp_path / "ours"
    command = [
        "benchmark",
        "tracking",
        "--sequences",
        str(made.folder),
        "--output",
        str(out),
        "--protocol",
        "paper",
    ]
    assert main([*command, "--report", str(out / "report")]) == 0
    rows = read_poses(out / "easy_00.csv")
    assert [row.frame for row in rows if row.reset] == [1, 16]
    head, easy = table(capsys.readouterr().out)
    assert easy[head.index("resets")] == "2"
    page = (out / "report" / "easy_00.html").read_text()
    assert "of 17 frames" in page and "set to the true pose" in page
    assert main([*command, "--count_resets", "--resume"]) == 0
    assert float(table(capsys.readouterr().out)[1][2].split()[0]) > float(easy[2].split()[0])


def test_one_bad_sequence_does_not_stop_the_others(
    sequences: Path, scene: Any, tmp_path: Path, capsys: Any
) -> None:
    bad = Pose(scene.pose(0).rotation, torch.tensor([9.0, 0, 0.5], dtype=torch.float64))
    bad.save(sequences / "easy_00" / "start.json")
    assert main(["benchmark", "tracking", "--sequences", str(sequences)]) == 2
    said = capsys.readouterr()
    assert [row[0] for row in table(said.out)] == ["level", "hard"]
    assert "easy_00: Start pose: the object is outside of the image" in said.err
    assert "1 of 2 sequences could not be tracked: easy_00." in said.err.splitlines()[-1]


def test_a_kept_track_gets_a_page_of_now(sequences: Path, tmp_path: Path) -> None:
    (sequences / "easy_00" / "frames" / "000002.png").write_bytes(b"no picture")
    report = tmp_path / "report"
    command = ["benchmark", "tracking", "--sequences", str(sequences), "--report", str(report)]
    command += ["--output", str(tmp_path / "out"), "--resume"]
    assert main(command) == 0
    (report / "easy_00.html").write_text("of an earlier track")
    assert main(command) == 0
    page = (report / "easy_00.html").read_text()
    assert "ADD" in page and "000002.png is not a readable image" in page


def test_kept_tracks_without_a_video_or_log_are_said(
    sequences: Path, tmp_path: Path, capsys: Any
) -> None:
    command = ["benchmark", "tracking", "--sequences", str(sequences)]
    command += ["--output", str(tmp_path / "out")]
    assert main([*command, "--only", "easy_00", "--overlays"]) == 0
    assert main([*command, "--only", "hard_01"]) == 0
    capsys.readouterr()
    assert main([*command, "--resume", "--overlays"]) == 0
    assert "hard_01: tracked earlier, so that no video" in capsys.readouterr().err
    assert main([*command, "--resume"]) == 0
    assert "tracked earlier" not in capsys.readouterr().err


def test_our_row_may_not_be_called_like_a_rival(sequences: Path, rivals: Path, capsys: Any) -> None:
    command = ["benchmark", "tracking", "--sequences", str(sequences), "--rivals", str(rivals)]
    assert main([*command, "--name", "other"]) == 2
    assert "--name other: a rival is called so" in capsys.readouterr().err


def test_a_signal_shows_what_was_tracked_and_is_the_exit_code(
    sequences: Path, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    def stop(self: Bench) -> None:
        raise Terminated(signal.SIGTERM)

    monkeypatch.setattr(Bench, "work", stop)
    code = main(["benchmark", "tracking", "--sequences", str(sequences)])
    assert code == 128 + signal.SIGTERM
    assert "stopped by SIGTERM" in capsys.readouterr().err


def test_a_video_of_a_track_has_the_rate_of_its_frames(
    sequences: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    import av

    monkeypatch.setattr("moveit6d.datasets.video.ImageList.fps", 60.0)
    command = ["benchmark", "tracking", "--sequences", str(sequences), "--only", "easy_00"]
    assert main([*command, "--overlays", "--output", str(tmp_path / "out")]) == 0
    with av.open(str(tmp_path / "out" / "easy_00.mp4")) as container:
        assert container.streams.video[0].average_rate == 60
