"""`moveit6d synthesize`: which sequences are asked for, and where they go."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from moveit6d.cli.main import main
from moveit6d.geometry.mesh import Mesh


@pytest.fixture
def asked(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Path, dict[str, Any]]]:
    """What the generator is asked for, without the minutes it takes."""
    calls: list[tuple[Path, dict[str, Any]]] = []

    def record(folder: Path, *, on_frame: Callable[[int], None], **options: Any) -> None:
        calls.append((folder, options))
        on_frame(0)

    monkeypatch.setattr("moveit6d.synthesis.sequences.sequence.write_sequence", record)
    return calls


def test_one_sequence_goes_to_the_folder_itself(
    asked: list[tuple[Path, dict[str, Any]]], brick: Mesh, brick_file: Path, capsys: Any
) -> None:
    command = ["synthesize", "--output", "clip", "--mesh", str(brick_file), "--seed", "4"]
    assert main([*command, "--frames", "7", "--difficulty", "hard"]) == 0
    ((folder, options),) = asked
    assert folder == Path("clip") and options["mesh"].diameter == brick.diameter
    assert (options["seed"], options["frames"], options["difficulty"]) == (4, 7, "hard")
    assert options["photos"] is None
    assert capsys.readouterr().out == "clip\n"


def test_several_sequences_are_numbered_and_differ(
    asked: list[tuple[Path, dict[str, Any]]], tmp_path: Path
) -> None:
    for number in range(3):
        Image.fromarray(np.full((90, 90, 3), number, np.uint8)).save(tmp_path / f"{number}.png")
    (tmp_path / "broken.png").write_bytes(b"\x89PNG")
    command = ["synthesize", "--output", "set", "--count", "2", "--difficulty", "easy"]
    assert main([*command, "--photos", str(tmp_path)]) == 0
    assert [folder for folder, _ in asked] == [Path("set/easy_00"), Path("set/easy_01")]
    first, second = (options for _, options in asked)
    assert (first["seed"], second["seed"]) == (0, 1)
    assert first["mesh"].diameter != second["mesh"].diameter, "another object each"
    assert [int(photo[0, 0, 0]) for photo in first["photos"]] == [0, 1, 2]


def test_photos_are_no_larger_than_a_background(
    asked: list[tuple[Path, dict[str, Any]]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Any,
) -> None:
    monkeypatch.setattr("moveit6d.cli.synthesize.PHOTOS", 2)
    for number, size in enumerate([(1800, 1400), (90, 90), (70, 80)]):
        Image.new("RGB", size, (number, 0, 0)).save(tmp_path / f"{number}.png")
    command = ["synthesize", "--output", "clip", "--photos", str(tmp_path)]
    assert main(command) == 0
    large, small = asked[0][1]["photos"]
    assert large.shape == (round(1400 * 896 / 1800), 896, 3) and small.shape == (80, 70, 3)
    assert large[0, 0, 0] == 0 and small[0, 0, 0] == 2, "evenly chosen"
    assert "left out" not in capsys.readouterr().err
    (tmp_path / "2.png").write_bytes(b"no picture")
    assert main(command) == 0 and len(asked[1][1]["photos"]) == 1
    assert "1 of 2 pictures are left out" in capsys.readouterr().err
    for name in ("0.png", "1.png"):
        (tmp_path / name).unlink()
    assert main(command) == 2 and len(asked) == 2, "not procedural pictures instead"
    assert "holds no readable picture of 64 pixels or more" in capsys.readouterr().err


def test_every_mesh_has_a_sequence(
    asked: list[tuple[Path, dict[str, Any]]], brick_file: Path, tmp_path: Path, capsys: Any
) -> None:
    other = tmp_path / "other.ply"
    other.write_bytes(brick_file.read_bytes())
    command = ["synthesize", "--output", "set", "--mesh", str(brick_file), str(other)]
    assert main(command) == 0
    assert [folder for folder, _ in asked] == [Path("set/medium_00"), Path("set/medium_01")]
    assert [options["mesh"].name for _, options in asked] == ["brick", "other"]
    assert main([*command, "--count", "3"]) == 0
    assert [options["mesh"].name for _, options in asked[2:]] == ["brick", "other", "brick"]
    assert main([*command, "--count", "1"]) == 2
    assert "--count 1 leaves out 1 of 2 meshes; leave out --count" in capsys.readouterr().err
    assert len(asked) == 5


def test_all_folders_are_looked_at_before_the_work(
    asked: list[tuple[Path, dict[str, Any]]], tmp_path: Path, capsys: Any
) -> None:
    (tmp_path / "easy_01").mkdir()
    (tmp_path / "easy_01" / "notes.txt").write_text("mine")
    words = ["synthesize", "--output", str(tmp_path), "--count", "2", "--difficulty", "easy"]
    assert main(words) == 2 and not asked
    assert "easy_01 exists and is not a sequence made here" in capsys.readouterr().err


@pytest.fixture
def surrogates(monkeypatch: pytest.MonkeyPatch) -> list[tuple[Any, ...]]:
    """What the makers of surrogates are asked for."""
    calls: list[tuple[Any, ...]] = []
    for name in ("write_laval_surrogate", "write_ycbv_surrogate"):
        monkeypatch.setattr(
            f"moveit6d.synthesis.sequences.surrogate_datasets.{name}",
            lambda *asked, name=name: calls.append(asked),
        )
    return calls


def test_a_laval_surrogate_has_the_meshes_and_levels(
    surrogates: list[tuple[Any, ...]], brick_file: Path, capsys: Any
) -> None:
    command = ["synthesize", "sequence", "--format", "laval", "--output", "data", "--seed", "5"]
    command += ["--mesh", str(brick_file), str(brick_file), "--frames", "9", "--difficulty", "easy"]
    assert main([*command, "--occlusion", "0", "60"]) == 0
    assert main(command) == 0
    (root, objects, options, levels), (*_, usual) = surrogates
    assert root == Path("data") and list(objects) == ["brick", "brick_1"]
    assert (options.frames, options.difficulty, options.seed) == (9, "easy", 5)
    assert list(levels) == [0, 60] and list(usual) == [0, 15, 30, 45]
    assert capsys.readouterr().out == "data\ndata\n"


def test_no_mesh_of_a_surrogate_takes_the_name_of_another(
    surrogates: list[tuple[Any, ...]], brick_file: Path, tmp_path: Path
) -> None:
    meshes = [tmp_path / place / name for place in "ab" for name in ("box.ply", "box_2.ply")]
    for mesh in meshes:
        mesh.parent.mkdir(exist_ok=True)
        mesh.write_bytes(brick_file.read_bytes())
    command = ["synthesize", "--format", "laval", "--output", "data", "--mesh", *map(str, meshes)]
    assert main(command) == 0
    ((_, objects, *_),) = surrogates
    assert list(objects) == ["box", "box_2", "box_3", "box_2_3"]


def test_a_ycbv_surrogate_has_another_object_in_the_middle_of_each_scene(
    surrogates: list[tuple[Any, ...]],
) -> None:
    assert main(["synthesize", "--format", "ycbv", "--output", "data", "--count", "5"]) == 0
    ((_, scenes, options),) = surrogates
    assert len(scenes) == 5 and options.frames == 120
    assert all(scene.keys() == scenes[0].keys() and len(scene) == 4 for scene in scenes)
    middles = [next(iter(scene)) for scene in scenes]
    assert len(set(middles)) == 4 and middles[4] == middles[0]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (["--occlusion", "15"], "--occlusion is for --format laval"),
        (["--format", "laval", "--count", "2"], "--count is not for --format laval"),
    ],
)
def test_options_of_other_formats_are_refused(
    options: list[str], words: str, tmp_path: Path, capsys: Any
) -> None:
    assert main(["synthesize", "--output", str(tmp_path / "new"), *options]) == 2
    assert words in capsys.readouterr().err


def test_a_missing_mesh_is_said(tmp_path: Path, capsys: Any) -> None:
    assert main(["synthesize", "--output", str(tmp_path), "--mesh", "no.obj"]) == 2
    assert "no.obj" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["synthesize --output x", "benchmark motion",
                                     "benchmark iteration"])  # fmt: skip
@pytest.mark.parametrize("option", ["--mesh_unit mm", "--allow_untextured"])
def test_options_about_a_mesh_need_one(command: str, option: str, capsys: Any) -> None:
    assert main([*command.split(), *option.split()]) == 2
    assert f"{option.split()[0]} needs --mesh, the file that it is" in capsys.readouterr().err
