"""What tools take of a fit's files: its unit, its held-out meshes, and the pictures it reads."""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.synthesis.augmentation.photos import photo_files
from tests.support.pairs import CONFIGS, photos
from tools.search_outcomes import Task, outcomes_of
from tools.training_files import add_options, data_of, main, read_photographs

pytestmark = pytest.mark.filterwarnings("ignore")


@pytest.fixture
def fit(tmp_path: Path) -> list[str]:
    """Options of a fit with 12 meshes."""
    for number in range(12):
        (tmp_path / f"{number:02d}.glb").touch()
    return ["--config", str(CONFIGS / "fit" / "compact.yaml"), f"--data.meshes={tmp_path}"]


@pytest.mark.parametrize("unit", ["mm", "cm", "in"])
def test_unit_and_held_out_meshes_are_those_of_the_fit(
    fit: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str], unit: str
) -> None:
    mine = tmp_path / "mine.yaml"
    mine.write_text(f"data:\n  mesh_unit: {unit}\n", encoding="utf-8")
    assert main([*fit, "--config", str(mine), "--data.holdout", "3", "--quiet"]) == 0
    printed = capsys.readouterr().out.split()
    assert printed == ["--mesh_unit", unit, "--holdout", "3"]
    parser = argparse.ArgumentParser()
    add_options(parser)
    folders = ["--meshes", str(tmp_path), "--photos", str(tmp_path)]
    data = data_of(parser.parse_args([*folders, *printed]))
    assert data.source().mesh_unit == unit
    assert [path.stem for path in data.mesh_paths()[1]] == ["02", "06", "10"]


@pytest.mark.parametrize(
    ("holdout", "words"),
    [("0", r"data\.holdout is 0, .* 2 or more"), ("1", "holdout is 1"), ("12", "holds 12 mesh")],
)
def test_what_later_parts_cannot_do_with_is_refused(
    fit: list[str], holdout: str, words: str
) -> None:
    with pytest.raises(InputError, match=words):
        main([*fit, "--data.holdout", holdout])


def test_pictures_are_those_that_a_fit_reads(tmp_path: Path) -> None:
    Image.fromarray(photos()[0]).save(tmp_path / "b.png")
    Image.fromarray(np.zeros((40, 400, 3), np.uint8)).save(tmp_path / "small.png")
    (tmp_path / "a.jpg").write_bytes(b"damaged")
    (tmp_path / "README.txt").write_text("pictures by ...")
    found = photo_files(tmp_path)
    assert [path.name for path in found] == ["a.jpg", "b.png", "small.png"]
    (only,) = read_photographs(found)
    assert np.array_equal(only, photos()[0])
    with pytest.raises(InputError, match="list of 1 photos holds no readable picture"):
        outcomes_of(Task(0, (), (tmp_path / "a.jpg",), tmp_path / "weights"))
    with pytest.raises(InputError, match=r"Photo folder .*nowhere does not exist"):
        photo_files(tmp_path / "nowhere")
