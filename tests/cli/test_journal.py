"""A journal keeps what was done until the result is whole."""

from __future__ import annotations

from argparse import Namespace
from pathlib import Path

import pytest

from moveit6d.cli.journal import Journal, file_facts, other_fact, read_journal
from moveit6d.errors import InputError

FACTS = {"split": "test", "weights": "a"}


def interrupted(output: Path) -> Path:
    with Journal(output, FACTS, resume=False) as journal:
        journal.add([1, "one"])
        journal.add([2, "two"])
        return journal.path


def test_what_was_done_is_gone_on_from(tmp_path: Path) -> None:
    path = interrupted(tmp_path / "r.csv")
    path.write_bytes(path.read_bytes() + b'[3, "half')  # killed while it wrote
    with Journal(tmp_path / "r.csv", FACTS, resume=True) as journal:
        assert journal.entries == [[1, "one"], [2, "two"]]
        journal.add([3, "three"])
    with Journal(tmp_path / "r.csv", FACTS, resume=True) as journal:
        assert journal.entries == [[1, "one"], [2, "two"], [3, "three"]]
        journal.finish()
    assert list(tmp_path.iterdir()) == []


def test_a_new_run_begins_anew(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = interrupted(tmp_path / "r.csv")
    assert Journal(tmp_path / "r.csv", FACTS, resume=False).entries == []
    with Journal(tmp_path / "r.csv", FACTS, resume=False) as journal:
        assert "--resume goes on" in capsys.readouterr().err
        assert len(read_journal(path)[1]) == 2, "until there is something to replace it"
        journal.add("new")
        assert read_journal(path) == (FACTS, ["new"])
    path.write_text("{}\n")
    with Journal(tmp_path / "r.csv", FACTS, resume=False):
        assert capsys.readouterr().err == "", "there was nothing to go on with"


def test_other_facts_and_damage_are_refused(tmp_path: Path) -> None:
    path = interrupted(tmp_path / "r.csv")
    with pytest.raises(InputError, match="run with another weights"):
        Journal(tmp_path / "r.csv", {**FACTS, "weights": "b"}, resume=True)
    for damage in ("{}\nno json\n", "[]\n", ""):
        path.write_text(damage)
        with pytest.raises(InputError, match="damaged; delete it"):
            Journal(tmp_path / "r.csv", FACTS, resume=True)


def test_a_file_goes_by_what_is_in_it(tmp_path: Path) -> None:
    mesh, camera = tmp_path / "can.obj", tmp_path / "camera.json"
    mesh.write_text("mtllib can.mtl")
    (tmp_path / "can.mtl").write_text("map_Kd can.png")
    (tmp_path / "can.png").write_text("red")
    camera.write_text("{}")
    args = Namespace(mesh=[mesh, mesh], camera=camera, start=None)
    before = {"mesh": "a", "camera": "b", "start": None, **file_facts(args)}
    assert before["mesh_sha256"][0] == before["mesh_sha256"][1] and before["start_sha256"] is None
    moved = {**before, "mesh": "another place"}
    assert other_fact(before, moved) is None
    (tmp_path / "can.png").write_text("green")
    assert other_fact(before, {**moved, **file_facts(args)}) == "mesh"
    (tmp_path / "can.png").write_text("red")
    camera.write_text("{} ")
    assert other_fact(before, {**moved, **file_facts(args)}) == "camera"


def test_a_record_of_before_is_compared_as_far_as_it_goes() -> None:
    now = {"mesh": "a.ply", "mesh_sha256": "1"}
    assert other_fact({"mesh": "a.ply"}, now) is None
    assert other_fact({"mesh": "b.ply"}, now) == "mesh"
    assert other_fact({"mesh": "a.ply"}, {**now, "initial": "2"}) == "initial", "another verb's"


def test_without_an_entry_nothing_is_written(tmp_path: Path) -> None:
    with pytest.raises(InputError), Journal(tmp_path / "r.csv", FACTS, resume=False):
        raise InputError("no such box")
    assert list(tmp_path.iterdir()) == []
    path = interrupted(tmp_path / "r.csv")
    before = path.read_bytes()
    for resume in (True, False):
        with pytest.raises(InputError), Journal(tmp_path / "r.csv", FACTS, resume=resume):
            raise InputError("no such box")
        assert path.read_bytes() == before, "what an earlier run did can still be gone on with"
