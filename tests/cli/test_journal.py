"""A journal keeps what was done until the result is whole."""

from __future__ import annotations

from pathlib import Path

import pytest

from moveit6d.cli.journal import Journal, read_journal
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
    with Journal(tmp_path / "r.csv", FACTS, resume=False):
        assert "--resume goes on" in capsys.readouterr().err
        assert read_journal(path) == (FACTS, [])
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


def test_one_without_an_entry_goes(tmp_path: Path) -> None:
    with pytest.raises(InputError), Journal(tmp_path / "r.csv", FACTS, resume=False):
        raise InputError("no such box")
    assert list(tmp_path.iterdir()) == []
    path = interrupted(tmp_path / "r.csv")
    with pytest.raises(InputError), Journal(tmp_path / "r.csv", FACTS, resume=True):
        raise InputError("no such box")
    assert path.exists(), "what an earlier run did can still be gone on with"
