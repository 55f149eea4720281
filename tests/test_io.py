"""Files appear whole or not at all, and JSON says what is wrong with it."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import pytest

from moveit6d.errors import InputError
from moveit6d.io import (
    check_places,
    discard,
    read_json,
    read_json_list,
    read_text,
    replacing,
    replacing_folder,
    write_json,
)


def test_json_holds_null_for_what_is_not_finite(tmp_path: Path) -> None:
    write_json(tmp_path / "a.json", {"mean": math.nan, "list": [math.inf, 1.5], "n": 3})
    assert json.loads((tmp_path / "a.json").read_text()) == {
        "mean": None,
        "list": [None, 1.5],
        "n": 3,
    }


def test_what_cannot_be_written_is_said(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(InputError, match="cannot be written"), replacing(tmp_path / "file" / "a"):
        pass
    with pytest.raises(InputError, match="is a folder"), replacing(tmp_path):
        pass


def test_an_error_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    path.write_text("old")
    with pytest.raises(RuntimeError), replacing(path) as temporary:
        temporary.write_text("half")
        raise RuntimeError
    assert path.read_text() == "old" and list(tmp_path.iterdir()) == [path]


def test_what_is_discarded_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "a.mp4"
    path.write_text("old")
    place = replacing(path)
    place.__enter__().write_text("half")
    discard(place)
    assert [one.read_text() for one in tmp_path.iterdir()] == ["old"]


def test_no_file_takes_the_place_of_an_input_or_of_another_output(tmp_path: Path) -> None:
    folder, own = tmp_path / "data", tmp_path / "own.csv"
    folder.mkdir()
    (folder / "there.csv").touch()
    for name, said in (("own.csv", "stays"), ("data/there.csv", "this run reads"), (".", "stays")):
        with pytest.raises(InputError, match=f"^--output: .* would be replaced, which {said}; "):
            check_places({"--output": [tmp_path / name]}, {own: "stays"}, [folder])
    check_places({"--output": [folder / "new.csv", None]}, {own: "stays"}, [folder])
    with pytest.raises(InputError, match=r"^--b: .*new\.csv would be replaced, which --a writes"):
        check_places({"--a": [folder / "new.csv"], "--b": [folder / "new.csv"]}, {})


def test_an_error_leaves_the_old_folder_and_no_other(tmp_path: Path) -> None:
    with replacing_folder(tmp_path / "set") as folder:
        (folder / "one").write_text("1")
    with pytest.raises(RuntimeError), replacing_folder(tmp_path / "set") as folder:
        (folder / "two").write_text("2")
        raise RuntimeError
    assert [path.name for path in tmp_path.rglob("*")] == ["set", "one"]


def left_behind(place: Path, hours: int) -> Path:
    """What a killed process left of a folder."""
    (place / "frames").mkdir(parents=True)
    (place / "frames" / "one").write_text("half")
    for path in (place / "frames" / "one", place / "frames", place):
        changed = path.stat().st_mtime - 3600 * hours
        os.utime(path, (changed, changed))
    return place


def test_a_killed_run_of_the_same_number_stops_no_folder(tmp_path: Path) -> None:
    left_behind(tmp_path / f".set.{os.getpid()}", hours=0)
    with replacing_folder(tmp_path / "set") as folder:
        (folder / "one").write_text("1")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["one", "set"]


def test_folders_of_killed_processes_are_removed_after_an_hour(tmp_path: Path) -> None:
    (tmp_path / "gone").write_text("")
    never = 2**22 - 1  # hardly a process has that number
    old = left_behind(tmp_path / f".set.{never}", hours=2)
    young = left_behind(tmp_path / f".set.{never - 1}", hours=0)
    written = left_behind(tmp_path / f".set.{never - 2}", hours=2)
    (written / "frames" / "one").write_text("another machine is at it")
    running = left_behind(tmp_path / f".set.{os.getppid()}", hours=2)
    dated = left_behind(tmp_path / ".set.20260131", hours=2)
    with replacing_folder(tmp_path / "set"):
        assert not old.exists()
    for kept in (young, written, running, dated):
        assert (kept / "frames" / "one").is_file()


def test_json_of_another_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.json").write_text("[1, 2]")
    assert read_json_list(tmp_path / "a.json") == [1, 2]
    with pytest.raises(InputError, match="one JSON object in braces"):
        read_json(tmp_path / "a.json")
    write_json(tmp_path / "b.json", {"a": 1})
    with pytest.raises(InputError, match="one JSON list in brackets"):
        read_json_list(tmp_path / "b.json")


def test_what_is_no_text_is_one_sentence(tmp_path: Path) -> None:
    with pytest.raises(InputError) as caught:
        read_text(tmp_path)
    assert str(caught.value) == f"{tmp_path} is a folder; give a file."
    (tmp_path / "a").write_bytes(b"\x93NUMPY")
    with pytest.raises(InputError, match="is not a text file"):
        read_text(tmp_path / "a")
