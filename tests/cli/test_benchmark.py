"""`moveit6d benchmark` and `moveit6d evaluate`: tables beside rivals, tracks, videos, times."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PIL import Image

from moveit6d.cli.main import main
from tests.support.configs import FAST_DETECTION
from tests.support.patches import BOX
from tests.support.settings_read import UNWRITTEN, offered, recorded

Make = Callable[..., Any]


@pytest.fixture
def without_material(tmp_path: Path) -> Path:
    """A folder with a mesh whose material file is missing."""
    folder = tmp_path / "objects"
    folder.mkdir()
    (folder / "box.obj").write_text(BOX.obj("mtllib gone.mtl\nusemtl skin\n"))
    return folder


def test_the_parts_of_an_iteration_are_printed(
    sequences: Path, brick_file: Path, capsys: Any
) -> None:
    assert (
        main(
            [
                "benchmark",
                "iteration",
                "--mesh",
                str(brick_file),
                "--repeats",
                "2",
                "--threads",
                "1",
            ]
        )
        == 0
    )
    text = capsys.readouterr().out
    for part in ("crop", "render", "observe", "network", "move", "sum", "whole iteration"):
        assert part in text
    assert "1 threads" in text and "median of 2" in text


@pytest.mark.parametrize(
    "words",
    [
        ["iteration", "--repeats", "1", "--mesh", "box.obj"],
        ["motion", "--speeds", "0", "--frames", "2", "--mesh", "box.obj"],
        ["refinement", "--number", "1", "--objects", ".", "--photos", "photos"],
        ["detection", "--limit", "1", "--objects", ".", "--photos", "photos", *FAST_DETECTION],
    ],
    ids=lambda words: str(words[0]),
)
def test_whoever_advises_an_option_has_it(
    without_material: Path, words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    (without_material / "photos").mkdir()
    Image.fromarray(np.full((120, 160, 3), 90, np.uint8)).save(
        without_material / "photos" / "0.png"
    )
    monkeypatch.chdir(without_material)
    assert main(["benchmark", *words]) == 2
    assert "pass --allow_untextured" in capsys.readouterr().err
    assert main(["benchmark", *words, "--allow_untextured"]) == 0
    said = capsys.readouterr()
    assert "gone.mtl" in said.err and said.out.count("\n") > 2


@pytest.mark.parametrize("command", ["tracking", "detection"])
def test_a_command_without_the_option_does_not_advise_it(
    make_sequence: Make, without_material: Path, capsys: Any, command: str
) -> None:
    folder = make_sequence("easy_00", frames=2).folder
    (folder / "mesh.ply").unlink()
    (without_material / "box.obj").rename(folder / "mesh.obj")
    assert main(["benchmark", command, "--sequences", str(folder)]) == 2
    said = capsys.readouterr().err
    assert "gone.mtl" in said and "put it beside the mesh.\n" in said


def test_the_oracle_runs_without_a_network_and_its_options(capsys: Any) -> None:
    assert main(["benchmark", "oracle", "--starts", "1"]) == 0
    assert "within half a step" in capsys.readouterr().out
    with pytest.raises(SystemExit) as ended:
        main(["benchmark", "oracle", "--starts", "1", "--float32"])
    assert ended.value.code == 2
    assert "there is no option --float32" in capsys.readouterr().err


@pytest.mark.parametrize("share", ["50", "-1", "nan", "half"])
def test_a_share_of_occluded_cases_is_from_0_to_1(share: str, capsys: Any) -> None:
    words = ["benchmark", "refinement", "--objects", ".", "--photos", ".", "--occluded", share]
    with pytest.raises(SystemExit) as ending:
        main(words)
    assert ending.value.code == 2 and "must be a number from 0 to 1" in capsys.readouterr().err


def test_options_of_rendered_images_are_the_settings_that_they_read(
    brick_file: Path, tmp_path: Path
) -> None:
    photo = np.random.default_rng(0).integers(0, 255, (160, 200, 3), np.uint8)
    Image.fromarray(photo).save(tmp_path / "photo.png")
    words = ["benchmark", "refinement", "--objects", str(brick_file.parent), "--number", "1"]
    words += ["--photos", str(tmp_path), "--multi_start.below", "1"]
    with recorded() as read:
        assert main(words) == 0
        assert main([*words, "--mode", "single", "--max_iterations", "2"]) == 0
    known = {one for one in read if one[0] not in ("DetectorConfig", "SeedDetectorConfig")}
    assert known - UNWRITTEN == offered("benchmark", "refinement")


@pytest.mark.parametrize(
    ("kind", "option"),
    [
        ("detection", "--recovery.interval"),
        ("detection", "--detection.region.stages"),
        ("motion", "--single_image.intercept"),
        ("recovery", "--multi_start.rounds"),
        ("tracking", "--loop.width_error"),
    ],
)
def test_options_that_change_nothing_do_not_exist(kind: str, option: str, capsys: Any) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["benchmark", kind, option, "1"])
    assert ended.value.code == 2 and f"there is no option {option}" in capsys.readouterr().err
