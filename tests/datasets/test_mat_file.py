"""MAT files: the same numbers as SciPy reads, and damage never more than a sentence."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.io import loadmat, savemat

from moveit6d.datasets.mat_file import read_mat
from moveit6d.errors import InputError

NAMES = ("cls_indexes", "poses", "intrinsic_matrix")


def write(path: Path, compressed: bool) -> dict[str, np.ndarray]:
    random = np.random.default_rng(0)
    content = {
        "vertmap": random.random((20, 30, 3)).astype(np.float32),
        "cls_indexes": np.array([[3], [200]], np.uint8),
        "poses": random.random((3, 4, 2)),
        "intrinsic_matrix": np.diag([1000.0, 1000, 1]),
        "text": "words",
        "x": np.array([1, 2, 3], np.int16),
    }
    savemat(path, content, do_compression=compressed)
    return content


@pytest.mark.parametrize("compressed", [False, True])
def test_the_numbers_are_those_that_scipy_reads(tmp_path: Path, compressed: bool) -> None:
    write(tmp_path / "a.mat", compressed)
    found, known = read_mat(tmp_path / "a.mat", (*NAMES, "x")), loadmat(tmp_path / "a.mat")
    assert set(found) == {*NAMES, "x"}
    for name, values in found.items():
        np.testing.assert_array_equal(values, known[name])
        assert values.dtype == known[name].dtype and values.shape == known[name].shape


@pytest.mark.parametrize("compressed", [False, True])
def test_damage_is_a_sentence(tmp_path: Path, compressed: bool) -> None:
    write(tmp_path / "a.mat", compressed)
    whole = (tmp_path / "a.mat").read_bytes()
    random, refused = np.random.default_rng(1), 0
    for _ in range(300):
        damaged = bytearray(whole)
        for place in random.integers(0, len(whole), random.integers(1, 5)):
            damaged[place] ^= 1 << int(random.integers(8))
        (tmp_path / "b.mat").write_bytes(damaged[: int(random.integers(1, len(damaged)))])
        try:
            read_mat(tmp_path / "b.mat", NAMES)
        except InputError as error:
            refused += 1
            assert "b.mat is not a readable MAT file" in str(error)
    assert refused > 100


def test_other_files_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(200))
    with pytest.raises(InputError, match="no header of version 5"):
        read_mat(tmp_path / "a.mat", NAMES)
