"""`kill -9` and full disks: what was found is on disk, whole, and a run that was ended goes on."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import torch

from moveit6d.cli.main import main
from moveit6d.datasets.bop import Estimate, Instance, read_results, write_results
from moveit6d.datasets.bop_writer import BopImage, write_bop
from moveit6d.datasets.pose_files import read_poses
from moveit6d.geometry.pose import Pose
from tests.support.forked import Forks

NUMBERS = (0, 1)


@pytest.fixture(scope="module")
def forks() -> Iterator[Forks]:
    made = Forks()
    yield made
    made.end()


@pytest.fixture(autouse=True)
def own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path_factory.getbasetemp() / "cache"))


@pytest.fixture
def oracle(brick_file: Path, scene: Any, tmp_path: Path) -> dict[str, Any]:
    scene.pose(0).save(tmp_path / "true.json")
    return {"mesh": str(brick_file), "unit": "m", "pose": str(tmp_path / "true.json"), "targets": 1}


@pytest.fixture
def bop(tmp_path: Path, scene: Any) -> Path:
    """The brick in two images, at one pose."""
    images = [
        BopImage(1, number, scene.image(0), scene.camera, [Instance(7, scene.pose(0))])
        for number in NUMBERS
    ]
    return write_bop(tmp_path / "set", "test", {7: scene.mesh}, images)


@pytest.fixture
def refine(bop: Path, scene: Any, tmp_path: Path) -> list[str]:
    true = scene.pose(0)
    off = Pose(true.rotation, true.translation + torch.tensor([0.003, 0, 0.005]).double())
    write_results(tmp_path / "initial.csv", [Estimate(1, n, 7, 0.5, off) for n in NUMBERS])
    return ["refine", "--dataset", str(bop), "--split", "test", "--output",
            str(tmp_path / "refined.csv"), "--initial", str(tmp_path / "initial.csv"),
            "--no_contour", "--no_multi_start"]  # fmt: skip


@pytest.fixture
def track(make_sequence: Any, tmp_path: Path) -> list[str]:
    folder = make_sequence("clip", frames=6, still=True).folder
    return ["track", "--mesh", str(folder / "mesh.ply"), "--mesh_unit", "m", "--video",
            str(folder / "frames"), "--camera", str(folder / "camera.json"), "--start",
            str(folder / "start.json"), "--output", str(tmp_path / "out"), "--no_contour",
            "--no_multi_start"]  # fmt: skip


def sentence(said: str) -> str:
    """The last line, if nothing else than it and notes was said."""
    assert "Traceback" not in said, said
    assert all(line.startswith("moveit6d: ") for line in said.splitlines()), said
    return said.splitlines()[-1]


def test_a_killed_refine_goes_on(
    forks: Forks, refine: list[str], oracle: dict[str, Any], tmp_path: Path
) -> None:
    code, _ = forks.run(*refine, oracle=oracle, kill=("moveit6d.cli.refine:refine_image", 2))
    assert code == -9 and not (tmp_path / "refined.csv").exists()
    kept = (tmp_path / "refined.csv.unfinished").read_bytes()
    assert kept.count(b"\n") == 2, "what it goes by, and an image"
    last = ("moveit6d.cli.refine:refine_image", 2)  # which is not called any more
    assert forks.run(*refine, "--resume", oracle=oracle, kill=last)[0] == 0
    assert [row.image for row in read_results(tmp_path / "refined.csv")] == [*NUMBERS]
    assert not list(tmp_path.glob("*refined*.unfinished"))


def test_killed_detections_go_on(
    forks: Forks, bop: Path, brick_file: Path, make_sequence: Any, tmp_path: Path
) -> None:
    folder = make_sequence("clip", frames=2, still=True).folder
    pictures = [str(folder / "frames" / f"{number:06d}.png") for number in (0, 1)]
    near = ["--distance", "0.4", "0.6"]
    images = ["detect", "--mesh", str(brick_file), "--mesh_unit", "m", "--image", *pictures,
              "--camera", str(folder / "camera.json"), "--output", str(tmp_path / "o"),
              *near]  # fmt: skip
    found = "moveit6d.cli.detect_images:_detected"
    assert forks.run(*images, kill=(found, 2))[0] == -9
    assert [row.frame for row in read_poses(tmp_path / "o" / "poses.csv")] == [0]
    code, said = forks.run(*images, "--instances", "2", "--resume")
    assert code == 2 and "a run with another instances" in sentence(said)
    assert forks.run(*images, "--resume", kill=(found, 2))[0] == 0
    rows = read_poses(tmp_path / "o" / "poses.csv")
    assert [row.frame for row in rows] == [0, 1] and all(row.pose for row in rows)
    assert {path.name for path in (tmp_path / "o").iterdir()} == {
        "poses.csv", "overlay", "detection.json",
    }  # fmt: skip
    targets = ["detect", "--dataset", str(bop), "--split", "test", *near]
    targets += ["--output", str(tmp_path / "r.csv")]
    image = "moveit6d.cli.detect_dataset:detect_image"
    assert forks.run(*targets, kill=(image, 2))[0] == -9
    assert forks.run(*targets, "--resume", kill=(image, 2))[0] == 0
    assert [row.image for row in read_results(tmp_path / "r.csv")] == [*NUMBERS]
    assert not list(tmp_path.glob("*.unfinished"))


def test_a_killed_benchmark_goes_on(
    forks: Forks, make_sequence: Any, oracle: dict[str, Any], tmp_path: Path
) -> None:
    names = ("easy_00", "easy_01")
    for name in names:
        make_sequence(name, frames=4, still=True)
    words = ["benchmark", "tracking", "--sequences", str(tmp_path / "sequences"), "--output",
             str(tmp_path / "out"), "--resume", "--no_contour", "--no_multi_start"]  # fmt: skip
    update = "moveit6d.estimation:PoseTracker.update"
    assert forks.run(*words, oracle=oracle, kill=(update, 6))[0] == -9
    tables = [read_poses(tmp_path / "out" / f"{name}.csv") for name in names]
    assert [len(table) for table in tables] == [4, 3]
    assert forks.run(*words, oracle=oracle, kill=(update, 4))[0] == 0, "three frames were missing"
    assert len(read_poses(tmp_path / "out" / "easy_01.csv")) == 4


def test_a_full_disk_keeps_the_rows(
    forks: Forks, track: list[str], oracle: dict[str, Any], tmp_path: Path
) -> None:
    update = "moveit6d.estimation:PoseTracker.update"
    assert forks.run(*track, "--no_overlay", oracle=oracle, kill=(update, 2))[0] == -9
    out = tmp_path / "out"
    journal, table = out / "poses.csv.unfinished", out / "poses.csv"
    size = journal.stat().st_size
    code, said = forks.run(*track, "--no_overlay", oracle=oracle, bytes_a_file=size)
    assert code == 2 and "summary.json cannot be written: File too large" in sentence(said)
    assert {path.name for path in out.iterdir()} == {journal.name, table.name}
    assert len(read_poses(table)) == 6
    first = tmp_path / "sequences" / "clip" / "frames" / "000000.png"
    for number in range(6, 30):  # with long names, which make long rows
        first.with_stem(f"{number:06d}{200 * 'x'}").write_bytes(first.read_bytes())
    code, said = forks.run(*track, "--no_overlay", oracle=oracle, bytes_a_file=size)
    assert code == 2 and "cannot be written" in sentence(said)
    kept = [row.frame for row in read_poses(table)]
    assert kept == [*range(len(kept))] and 6 < len(kept) < 30
    code, said = forks.run(*track, "--no_overlay", "--resume", oracle=oracle)
    assert code == 0 and [row.frame for row in read_poses(table)] == [*range(30)]
    assert {path.name for path in out.iterdir()} == {table.name, "summary.json"}


def test_a_killed_track_goes_on_with_what_it_was_begun_with(
    forks: Forks, track: list[str], oracle: dict[str, Any], tmp_path: Path
) -> None:
    out, update = tmp_path / "out", "moveit6d.estimation:PoseTracker.update"
    track += ["--no_overlay", "--threads", "1"]
    assert forks.run(*track, oracle=oracle, kill=(update, 3))[0] == -9
    rows = (out / "poses.csv").read_bytes()
    assert {path.name for path in out.iterdir()} == {"poses.csv", "poses.csv.unfinished"}
    code, said = forks.run(*track, "--resume", "--loop.max_iterations", "1", oracle=oracle)
    assert code == 2 and "a track with another --loop.max_iterations;" in sentence(said)
    assert (out / "poses.csv").read_bytes() == rows
    assert forks.run(*track, "--resume", oracle=oracle, kill=(update, 3))[0] == -9
    code, said = forks.run(*track, "--resume", "--mode", "single", oracle=oracle)
    assert code == 2 and "a track with another --" in sentence(said)
    assert forks.run(*track, "--resume", oracle=oracle)[0] == 0
    assert [row.frame for row in read_poses(out / "poses.csv")] == [*range(6)]
    assert (out / "poses.csv").read_bytes().startswith(rows)
    assert {path.name for path in out.iterdir()} == {"poses.csv", "summary.json"}
    whole = {path: path.read_bytes() for path in out.iterdir()}
    assert forks.run(*track, "--no_contour", oracle=oracle, kill=(update, 1))[0] == -9
    assert {path: path.read_bytes() for path in out.iterdir()} == whole, "it had no frame"
    code, said = forks.run(*track, "--no_contour", "--resume", "--mode", "single", oracle=oracle)
    assert code == 2 and "a track with another --loop.mode;" in sentence(said)


def test_a_full_disk_keeps_what_was_refined(
    forks: Forks, refine: list[str], oracle: dict[str, Any], tmp_path: Path
) -> None:
    image = "moveit6d.cli.refine:refine_image"
    assert forks.run(*refine, oracle=oracle, kill=(image, 2))[0] == -9
    size = (tmp_path / "refined.csv.unfinished").stat().st_size  # with one of two images
    code, said = forks.run(*refine, oracle=oracle, bytes_a_file=size + 20)
    assert code == 2 and "cannot be written: File too large" in sentence(said)
    assert forks.run(*refine, "--resume", oracle=oracle, kill=(image, 2))[0] == 0
    assert len(read_results(tmp_path / "refined.csv")) == 2


@pytest.mark.parametrize(
    ("verb", "options", "work"),
    [
        ("track", ("--output",), "moveit6d.estimation.PoseTracker.update"),
        ("refine", ("--output",), "moveit6d.cli.refine.refine_image"),
        ("calibrate", ("--output",), "moveit6d.cli.calibrate._views"),
        (
            "benchmark",
            ("--output", "--report", "--rerun"),
            "moveit6d.cli.benchmark_tracking.chosen",
        ),
    ],
)
@pytest.mark.parametrize("kind", ["below a file", "read-only"])
def test_a_place_that_cannot_be_written_is_said_before_the_work(
    request: pytest.FixtureRequest, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str], verb: str, options: tuple[str, ...], work: str, kind: str,
) -> None:  # fmt: skip
    def never(*_: Any, **__: Any) -> Any:
        raise AssertionError("work was begun")

    monkeypatch.setattr(work, never)
    place = tmp_path / "place"
    if kind == "read-only":  # which the superuser of a container would not notice
        place.mkdir()
        touch = Path.touch

        def refused(path: Path, *more: Any) -> None:
            if path.parent.is_relative_to(place):
                raise PermissionError(13, "Permission denied")
            touch(path, *more)

        monkeypatch.setattr(Path, "touch", refused)
    else:
        place.write_text("a file")
    words = {
        "calibrate": ["calibrate", "--video", str(tmp_path)],
        "benchmark": ["benchmark", "tracking", "--sequences", str(tmp_path)],
    }
    given = words[verb] if verb in words else list(request.getfixturevalue(verb))
    if "--output" in given:
        del given[given.index("--output") : given.index("--output") + 2]
    for option in options:
        assert main([*given, option, str(place / "new")]) == 2
        assert "cannot be" in sentence(capsys.readouterr().err)
    assert not any(tmp_path.rglob("*.probe"))
