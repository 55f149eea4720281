"""`moveit6d reproduce` and `moveit6d detect`: every name prints, writes and names its data."""

from __future__ import annotations

import csv
import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.cli import reproduce
from moveit6d.cli.main import main, make_parser
from moveit6d.cli.reproduce import RUNS, _tracks
from moveit6d.config import ActionMode
from moveit6d.datasets.laval import write_laval_sequence
from moveit6d.datasets.pose_files import read_poses, write_camera, write_poses
from moveit6d.datasets.sequences import read_sequences
from moveit6d.datasets.ycbv import write_ycbv_scene
from moveit6d.estimation import PoseTracker
from moveit6d.evaluation.runner import OWN_COLUMNS
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from tests.support.settings_read import UNWRITTEN, offered, recorded

Make = Callable[..., Any]
FRAMES = 4


@pytest.fixture
def oracle(monkeypatch: pytest.MonkeyPatch, scene: Any) -> None:
    """Every command decides by the pose of the brick that stands still."""
    truth = Pose.stack([scene.mesh.inner(scene.pose(0))] * 64)

    def load(*_: Any, **__: Any) -> OraclePolicy:
        return OraclePolicy(truth, ActionMode.ALL_AXES)

    monkeypatch.setattr("moveit6d.policies.load_policy", load)


@pytest.fixture
def own(make_sequence: Make, oracle: None) -> Path:
    """A sequence folder of one's own."""
    folder: Path = make_sequence("easy_00", frames=FRAMES, still=True).folder
    return folder


@pytest.fixture
def laval(tmp_path: Path, scene: Any, oracle: None) -> Path:
    """Laval's format: one object at two levels."""
    shots = [(scene.image(0), scene.pose(0))] * FRAMES
    for name in ("dog_occlusion_0", "dog_occlusion_h_15"):
        write_laval_sequence(tmp_path / "laval", name, scene.mesh, scene.camera, shots)
    return tmp_path / "laval"


def report(folder: Path, name: str) -> dict[str, Any]:
    """NAME.json, after a look at what must lie beside it."""
    content: dict[str, Any] = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    for suffix in ("md", "png", "svg"):
        assert list(folder.glob(f"*.{suffix}")), suffix
    assert content["name"] == name and content["facts"]["mode"]
    return content


def test_ycb_tables_come_from_the_same_tracks(
    tmp_path: Path, scene: Any, oracle: None, capsys: Any
) -> None:
    data, out = tmp_path / "ycbv", tmp_path / "out"
    shots = [(scene.image(0), {15: scene.pose(0)})] * FRAMES
    write_ycbv_scene(data, 50, {15: scene.mesh}, scene.camera, shots)
    for name in ("ycb_add", "ycb_auc"):
        assert main(["reproduce", name, "--data", str(data), "--output", str(out)]) == 0
        said = capsys.readouterr()
        assert "surrogate (in YCB-Video's format" in said.out and "oracle" in said.out
        content = report(out, name)
    first = content["tables"]["auc_1"][0]
    assert first["object"] == "035_power_drill" and first["PoseCNN"] == 55.10
    assert first["ours ADD(-S)"] == pytest.approx(100, abs=0.1)
    assert [p.name for p in (out / "tracks").glob("*.csv")] == ["0050.035_power_drill.csv"]
    rows = list(csv.DictReader((out / "ycb_add_add.csv").read_text().splitlines()))
    assert rows[0]["ours ADD(-S)"] == "100.0" and rows[-1]["paper OS"] == "63.05"
    other = ["reproduce", "ycb_add", "--data", str(data), "--output", str(out), "--frames", "2"]
    before = (out / "tracks" / "0050.035_power_drill.csv").read_text()
    assert main(other) == 0, "tracks of other settings are made anew"
    after = (out / "tracks" / "0050.035_power_drill.csv").read_text()
    assert len(after.splitlines()) == 1 + 1 + 2 < len(before.splitlines())


def test_tracks_of_other_images_are_made_anew(
    own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls: list[int] = []
    update = PoseTracker.update

    def record(self: PoseTracker[Any], image: Any) -> Any:
        calls.append(1)
        return update(self, image)

    monkeypatch.setattr(PoseTracker, "update", record)
    videos = read_sequences(own)
    options = ["--data", str(own), "--output", str(tmp_path / "out"), "--repeats", "1"]
    args = make_parser().parse_args(["reproduce", "runtime", *options])

    def made() -> int:
        _tracks(args, videos, None)
        return len(calls)

    first = made()
    assert first > 0 and made() == first
    picture = own / "frames" / "000002.png"
    picture.write_bytes(picture.read_bytes() + b"more")
    assert made() == 2 * first
    videos = [replace(video, camera=replace(video.camera, fx=179.0)) for video in videos]
    assert made() == 3 * first


def test_laval_has_a_column_a_model(laval: Path, tmp_path: Path, capsys: Any) -> None:
    flat = tmp_path / "flat.safetensors"
    flat.touch()
    out = tmp_path / "out"
    command = ["reproduce", "laval", "--data", str(laval), "--output", str(out)]
    assert main([*command, "--no_depth_weights", str(flat)]) == 0
    assert "surrogate (in Laval's format" in capsys.readouterr().out
    content = report(out, "laval")
    dog = next(row for row in content["tables"]["errors"] if row["object"] == "dog")
    assert dog["ours full 15 %"] == pytest.approx(0, abs=1e-3)
    assert dog["ours w/o depth 0 %"] == pytest.approx(0, abs=1e-3)
    assert dog["ours full 30 %"] is None and dog["paper full 30 %"] == 55.48
    assert len(list((out / "tracks_no_depth").glob("*.csv"))) == 2


def test_convergence_runs_both_readings(own: Path, tmp_path: Path, capsys: Any) -> None:
    out = tmp_path / "out"
    options = ["--m", "0", "2", "--frames", "1", "--output", str(out)]
    assert main(["reproduce", "convergence", "--data", str(own), *options]) == 0
    assert "sequence folders of one's own" in capsys.readouterr().out
    content = report(out, "convergence")
    rows = content["tables"]["convergence"]
    assert [(row["reading"], row["m"]) for row in rows] == [
        ("formula", 0),
        ("formula", 2),
        ("total", 0),
        ("total", 2),
    ]
    assert all(row["ADD<10%d"] == 100 for row in rows)
    assert (
        content["facts"]["mode"] == "single"
        and content["facts"]["config"]["loop"]["step_size"] == 3
    )


def test_runtime_with_and_without_data(own: Path, tmp_path: Path, capsys: Any) -> None:
    for extra in ([], ["--data", str(own)]):
        out = tmp_path / f"out{len(extra)}"
        command = ["reproduce", "runtime", "--repeats", "2", "--output", str(out), *extra]
        assert main(command) == 0
        content = report(out, "runtime")
        assert ("frames" in content["tables"]) == bool(extra)
        assert content["tables"]["iteration"][1]["paper"] == 5.2
        assert "surrogate" in capsys.readouterr().out


def test_options_of_convergence_are_the_settings_that_it_reads(own: Path, tmp_path: Path) -> None:
    words = ["reproduce", "convergence", "--data", str(own), "--frames", "1", "--m", "2"]
    words += ["--output", str(tmp_path / "out")]
    with recorded() as read:
        assert main(words) == 0
        assert main([*words, "--mode", "all_axes", "--loop.fine_stage", "true"]) == 0
    assert {one for one in read if one[0] == "LoopConfig"} - UNWRITTEN == offered(*words[:2])
    assert not offered("reproduce", "attention")


def test_frame_times_are_those_of_this_run(own: Path, tmp_path: Path) -> None:
    command = ["reproduce", "runtime", "--repeats", "2", "--data", str(own), "--output"]
    command.append(str(tmp_path / "out"))
    assert main(command) == 0
    for table in (tmp_path / "out" / "tracks").glob("*.csv"):
        rows = [replace(row, milliseconds=9999.0) for row in read_poses(table)]
        write_poses(table, rows, OWN_COLUMNS)
    assert main(command) == 0
    frames = report(tmp_path / "out", "runtime")["tables"]["frames"]
    assert all((row["ms measured"] or 0) < 9999 for row in frames)


def test_workers_elsewhere_find_the_data(own: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(own.parent)
    words = ["reproduce", "ycb_add", "--data", own.name, "--output", "out"]
    videos, _ = reproduce._opened(make_parser().parse_args(words))
    assert all(video.mesh.is_absolute() and video.frames.is_absolute() for video in videos)


def test_attention_of_a_network(own: Path, tmp_path: Path) -> None:
    """A policy without attention has a column that says so."""
    out = tmp_path / "out"
    assert main(["reproduce", "attention", "--data", str(own), "--output", str(out)]) == 0
    (row,) = report(out, "attention")["tables"]["attention"]
    assert row["network"] == "model" and row["mean on the object"] is None


def test_every_checkpoint_has_a_column_and_computes_as_asked(
    own: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    loaded: list[tuple[str, str]] = []

    def load(path: Path | None = None, *, compute: str = "auto") -> OraclePolicy:
        loaded.append(("" if path is None else path.name, compute))
        return OraclePolicy(Pose.identity(1), ActionMode.ALL_AXES)

    monkeypatch.setattr("moveit6d.policies.load_policy", load)
    folder = Path(__file__).resolve().parents[2] / "examples" / "object_specific"
    files = sorted(folder.glob("*.safetensors"))
    assert len(files) == 2
    out = tmp_path / "out"
    command = ["reproduce", "attention", "--data", str(own), "--output", str(out), "--float32"]
    assert main([*command, "--checkpoints", *map(str, files)]) == 0
    rows = report(out, "attention")["tables"]["attention"]
    names = ["25000 steps (gz_suv)", "25000 steps (scan_conditioner)", "model"]
    assert [row["network"] for row in rows] == names
    assert loaded == [("", "float32"), *((file.name, "float32") for file in files)]


def test_detection_is_scored_by_both_criteria(own: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    options = ["--sinks", "1", "--poses", "1", "--rotations", "2", "--sizes", "0.4"]
    options += ["--mode", "all_axes"]
    command = ["reproduce", "detection", "--data", str(own), "--output", str(out)]
    assert main([*command, *options]) == 0
    summary = {row[""]: row["ours"] for row in report(out, "detection")["tables"]["summary"]}
    assert summary["ADD < 10 % d, criterion iterations, %"] == 100
    assert summary["ADD < 10 % d, criterion confidence, %"] == 100


def test_what_cannot_be_done_is_said(own: Path, tmp_path: Path, capsys: Any) -> None:
    out = ["--output", str(tmp_path / "out")]
    for options, message in (
        (["laval", "--data", str(own)], "OBJECT_occlusion_0"),
        (["ycb_add", "--data", str(own), "--only", "nobody"], "no sequence nobody"),
        (["ycb_add", "--data", str(tmp_path / "nowhere")], "is not a folder"),
        (["laval", "--data", str(own), "--format", "laval"], "Laval"),
    ):
        assert main(["reproduce", *options, *out]) == 2
        assert message in capsys.readouterr().err


@pytest.mark.parametrize("name", sorted(RUNS))
def test_every_name_has_a_manual_page(name: str, capsys: Any) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["reproduce", name, "--help"])
    text = capsys.readouterr().out
    assert ended.value.code == 0 and f"moveit6d reproduce {name} --" in text
    assert max(map(len, text.splitlines())) <= 100


def test_detect_writes_a_start(
    tmp_path: Path, scene: Any, brick_file: Path, oracle: None, capsys: Any
) -> None:
    from PIL import Image

    Image.fromarray(scene.image(0)).save(tmp_path / "first.png")
    write_camera(tmp_path / "camera.json", scene.camera)
    files = ["--image", str(tmp_path / "first.png"), "--camera", str(tmp_path / "camera.json")]
    command = ["detect", "--mesh", str(brick_file), "--mesh_unit", "m", *files]
    options = ["--method", "seeds", "--rotations", "2", "--sinks", "1", "--sizes", "0.4"]
    out = tmp_path / "found"
    assert main([*command, *options, "--output", str(out)]) == 0
    assert "probability 1.00" in capsys.readouterr().out
    found, true = Pose.load(out / "pose.json"), scene.pose(0)
    torch.testing.assert_close(found.translation, true.translation, atol=1e-3, rtol=0)
    overlay = np.asarray(Image.open(out / "overlay.png"))
    assert overlay.shape == (120, 160, 3) and (overlay != scene.image(0)).any()
    facts = json.loads((out / "detection.json").read_text(encoding="utf-8"))
    image = facts["images"][0]
    assert image["candidates"] == 2 and len(image["sinks"]) == 1
    write_camera(tmp_path / "camera.json", replace(scene.camera, width=100, height=100))
    assert main([*command, "--output", str(out)]) == 2


@pytest.mark.parametrize("name", ["attention", "convergence", "detection"])
def test_frames_that_cannot_be_read_are_said(
    own: Path, tmp_path: Path, capsys: Any, name: str
) -> None:
    own_options = {
        "convergence": ["--m", "0", "--reading", "total"],
        "detection": ["--sinks", "1", "--poses", "1", "--rotations", "1", "--sizes", "0.4"],
    }
    command = ["reproduce", name, "--data", str(own), "--output", str(tmp_path / "out")]
    command += ["--frames", str(FRAMES), *own_options.get(name, [])]
    pictures = sorted((own / "frames").iterdir())
    pictures[1].write_bytes(b"no picture")
    assert main(command) == 0
    assert f"1 of {FRAMES} frames could not be read and are left out" in capsys.readouterr().err
    for picture in pictures:
        picture.write_bytes(b"no picture")
    assert main(command) == 2
    assert f"{own}: no frame with a true pose could be read" in capsys.readouterr().err
