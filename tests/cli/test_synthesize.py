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

    monkeypatch.setattr("moveit6d.synthesis.sequence.write_sequence", record)
    return calls


def test_one_sequence_goes_to_the_folder_itself(
    asked: list[tuple[Path, dict[str, Any]]], brick: Mesh, brick_file: Path, capsys: Any
) -> None:
    command = ["synthesize", "--output", "clip", "--mesh", str(brick_file), "--seed", "4"]
    assert main([*command, "--frames", "7", "--level", "hard"]) == 0
    ((folder, options),) = asked
    assert folder == Path("clip") and options["mesh"].diameter == brick.diameter
    assert (options["seed"], options["frames"], options["level"]) == (4, 7, "hard")
    assert options["photos"] is None
    assert capsys.readouterr().out == "clip\n"


def test_several_sequences_are_numbered_and_differ(
    asked: list[tuple[Path, dict[str, Any]]], tmp_path: Path
) -> None:
    for number in range(3):
        Image.fromarray(np.full((90, 90, 3), number, np.uint8)).save(tmp_path / f"{number}.png")
    (tmp_path / "broken.png").write_bytes(b"\x89PNG")
    command = ["synthesize", "--output", "set", "--count", "2", "--level", "easy"]
    assert main([*command, "--photos", str(tmp_path)]) == 0
    assert [folder for folder, _ in asked] == [Path("set/easy_00"), Path("set/easy_01")]
    first, second = (options for _, options in asked)
    assert (first["seed"], second["seed"]) == (0, 1)
    assert first["mesh"].diameter != second["mesh"].diameter, "another object each"
    assert [int(photo[0, 0, 0]) for photo in first["photos"]] == [0, 1, 2]


def test_a_missing_mesh_is_said(tmp_path: Path, capsys: Any) -> None:
    assert main(["synthesize", "--output", str(tmp_path), "--mesh", "no.obj"]) == 2
    assert "no.obj" in capsys.readouterr().err
