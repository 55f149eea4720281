"""A folder goes on with one fit alone."""

from pathlib import Path

import pytest

from lightning_modules.fit_record import RECORD, claim
from moveit6d.errors import InputError
from moveit6d.io import read_json

FACTS = {
    "model.network": "ActionNet",
    "data.meshes": "a",
    "data.pairs": {"zoom": {"factor": (1, 2)}},
}


def test_a_fit_writes_down_what_it_goes_by(tmp_path: Path) -> None:
    claim(tmp_path, FACTS)
    assert read_json(tmp_path / RECORD) == {
        "model.network": "ActionNet", "data.meshes": "a", "data.pairs.zoom.factor": [1, 2]
    }  # fmt: skip


def test_another_fit_is_refused_by_what_differs(tmp_path: Path) -> None:
    claim(tmp_path, FACTS)
    (tmp_path / "last.ckpt").touch()
    claim(tmp_path, FACTS)
    other = {**FACTS, "data.meshes": "b", "data.pairs": {"zoom": {"factor": (1, 3)}}}
    with pytest.raises(InputError) as error:
        claim(tmp_path, other)
    words = ("another data.meshes, data.pairs.zoom.factor;", "another --output", "--ckpt_path")
    assert all(word in str(error.value) for word in words)
    assert read_json(tmp_path / RECORD)["data.meshes"] == "a"


def test_a_folder_without_a_checkpoint_is_anyone_s(tmp_path: Path) -> None:
    claim(tmp_path, FACTS)
    claim(tmp_path, {**FACTS, "data.meshes": "b"})
    assert read_json(tmp_path / RECORD)["data.meshes"] == "b"


def test_what_is_of_an_earlier_version_goes_on(tmp_path: Path) -> None:
    (tmp_path / "last.ckpt").touch()
    claim(tmp_path, FACTS)
    assert not (tmp_path / RECORD).exists(), "nobody knows what the checkpoint goes by"
    (tmp_path / "last.ckpt").unlink()
    claim(tmp_path, FACTS)
    (tmp_path / "last.ckpt").touch()
    claim(tmp_path, {**FACTS, "data.new_option": 1})
