"""Surrogate data sets for published data sets: formats, truth, and that they say what they are."""

from __future__ import annotations

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from moveit6d.datasets import open_dataset
from moveit6d.datasets.catalog import recognise, surrogate
from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.synthesis.sequences.surrogate_datasets import (
    GenerationOptions,
    object_name,
    write_laval_surrogate,
    write_ycbv_surrogate,
)
from tests.support.meshes import colored_box

SMALL = Camera(205.0, 205.0, 106.0, 79.5, 213, 160)
OPTIONS = GenerationOptions(frames=2, difficulty="easy", seed=4)


@pytest.fixture(scope="module")
def box() -> Mesh:
    return colored_box((0.12, 0.1, 0.08))


def visible(root: Path) -> dict[str, list[float]]:
    found: dict[str, list[float]] = {}
    with (root / "visible_fraction.csv").open() as file:
        for row in csv.DictReader(file):
            found.setdefault(row["sequence"], []).append(float(row["visible_fraction"]))
    return found


def test_laval(tmp_path: Path, box: Mesh) -> None:
    root, told = tmp_path / "laval", []
    options = replace(OPTIONS, on_frame=lambda name, number: told.append((name, number)))
    write_laval_surrogate(root, {"box": box}, options, (0, 30), SMALL)
    assert recognise(root) == "laval" and surrogate(root) == "surrogate for Laval"
    found = open_dataset(root)
    assert [(one.name, one.level) for one in found] == [
        ("box_occlusion_0", "occlusion_0"),
        ("box_occlusion_h_30", "occlusion_30"),
        ("box_occlusion_v_30", "occlusion_30"),
    ]
    assert told == [(one.name, k) for one in found for k in range(2)]
    assert found[0].camera == SMALL
    assert found[0].load_mesh().diameter == pytest.approx(box.diameter, rel=1e-5)
    shares = visible(root)
    assert shares["box_occlusion_0"] == [1.0, 1.0]
    for name in ("box_occlusion_h_30", "box_occlusion_v_30"):
        np.testing.assert_allclose(shares[name], 0.7, atol=0.05)
    # The same motion before each board.
    difference = found[0].truth[1].matrix - found[2].truth[1].matrix
    assert difference.abs().max() < 1e-12
    assert [frame.image.shape for frame in found[1].open() if frame.image is not None] == [
        (160, 213, 3)
    ] * 2


def test_ycbv(tmp_path: Path, box: Mesh) -> None:
    root = tmp_path / "ycbv"
    bar = colored_box((0.2, 0.06, 0.05), (0.1, 0, 0))
    scenes = [{"box": box, "bar": bar}, {"bar": bar}]
    write_ycbv_surrogate(root, scenes, OPTIONS, SMALL)
    assert recognise(root) == "ycbv" and surrogate(root) == "surrogate for YCB-Video"
    found = open_dataset(root)
    assert [one.name for one in found] == ["0048.box", "0048.bar", "0049.bar"]
    assert visible(root).keys() == {one.name for one in found}
    assert found[1].load_mesh().center == pytest.approx([0.1, 0, 0], abs=1e-6)
    assert found[0].keyframes == {0} and not found[0].symmetric


def test_another_folder_is_left_alone(tmp_path: Path, box: Mesh) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="is not a data set made here"):
        write_laval_surrogate(tmp_path, {"box": box}, OPTIONS, (0,), SMALL)
    assert [path.name for path in tmp_path.iterdir()] == ["thesis.txt"]


def test_a_file_is_left_alone(tmp_path: Path, box: Mesh) -> None:
    thesis = tmp_path / "thesis.txt"
    thesis.write_text("years of work")
    with pytest.raises(InputError, match=r"thesis\.txt is a file"):
        write_laval_surrogate(thesis, {"box": box}, OPTIONS, (0,), SMALL)
    assert thesis.read_text() == "years of work"


def test_an_older_surrogate_is_replaced_and_a_broken_one_leaves_nothing(
    tmp_path: Path, box: Mesh
) -> None:
    root = tmp_path / "laval"
    write_laval_surrogate(root, {"old": box}, OPTIONS, (0,), SMALL)

    def stop(name: str, number: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_laval_surrogate(root, {"b": box}, replace(OPTIONS, on_frame=stop), (0,), SMALL)
    assert [one.name for one in open_dataset(root)] == ["old_occlusion_0"]
    write_laval_surrogate(root, {"new": box}, OPTIONS, (0,), SMALL)
    assert [one.name for one in open_dataset(root)] == ["new_occlusion_0"]
    assert [path.name for path in tmp_path.iterdir()] == ["laval"]


@pytest.mark.parametrize("levels", [(), (100,), (-5, 0)])
def test_impossible_levels_are_said(tmp_path: Path, box: Mesh, levels: tuple[int, ...]) -> None:
    with pytest.raises(InputError, match="per cent from 0 to 99"):
        write_laval_surrogate(tmp_path / "laval", {"box": box}, OPTIONS, levels, SMALL)


def test_names_are_those_of_folders(box: Mesh) -> None:
    assert object_name(replace(box, name="Textured Box-2")) == "textured_box_2"
    assert object_name(replace(box, name="!?")) == "object"


def test_what_was_added_to_an_earlier_data_set_is_left_alone(tmp_path: Path, box: Mesh) -> None:
    root = tmp_path / "laval"
    write_laval_surrogate(root, {"box": box}, OPTIONS, (0,), SMALL)
    write_laval_surrogate(root, {"box": box}, OPTIONS, (0,), SMALL)  # its own are replaced
    (root / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match=r"holds thesis\.txt beside a data set made here"):
        write_laval_surrogate(root, {"box": box}, OPTIONS, (0,), SMALL)
    assert (root / "thesis.txt").read_text() == "years of work"
