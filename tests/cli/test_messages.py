"""What a command says on stderr: notes, details, and progress where there is no terminal."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from moveit6d.cli import common, messages
from moveit6d.cli.common import Setting
from moveit6d.cli.messages import ProgressLines, detail, note, progress, set_level


@pytest.fixture(autouse=True)
def _normal() -> Iterator[None]:
    set_level(False, False)
    yield
    set_level(False, False)


@pytest.mark.parametrize(
    ("quiet", "verbose", "said"),
    [(False, False, ["one"]), (True, False, []), (False, True, ["one", "two"])],
)
def test_levels(
    quiet: bool, verbose: bool, said: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    set_level(quiet, verbose)
    note("one")
    detail("two")
    assert capsys.readouterr().err.splitlines() == [f"moveit6d: {word}" for word in said]


class Clock:
    now = 0.0

    def __call__(self) -> float:
        return self.now


def lines(total: int | None, seconds: float, count: int) -> list[str]:
    """What is said when `count` items take so many seconds each."""
    said: list[str] = []
    clock = Clock()
    with ProgressLines(total, "track", "frame", said.append, clock) as bar:
        for _ in range(count):
            clock.now += seconds
            bar.update()
    return said


def test_a_line_each_tenth() -> None:
    said = lines(400, 0.0625, 400)
    assert len(said) == 10
    assert said[0] == "track: 40 of 400 frames (10 %), 62 ms each, 0:22 left"


def test_not_more_often_than_every_two_seconds_nor_less_than_every_thirty() -> None:
    assert len(lines(100, 0.001, 100)) == 0
    slow = lines(10_000, 1.0, 120)
    assert len(slow) == 4 and "1.0 s each" in slow[0]
    unknown = lines(None, 0.5, 130)
    assert unknown == ["track: 60 frames, 500 ms each", "track: 120 frames, 500 ms each"]


def test_progress_passes_the_items_on(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(messages, "SOONEST", 0.0)
    assert list(progress(range(10), 10, "work", "thing")) == list(range(10))
    assert len(capsys.readouterr().err.splitlines()) == 10
    set_level(True, False)
    assert list(progress(range(10), 10, "work", "thing")) == list(range(10))
    assert capsys.readouterr().err == ""


def test_a_worker_says_as_much_as_its_parent(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(common, "make_tools", lambda setting: None)
    common.tools.cache_clear()
    set_level(True, False)
    setting = Setting(None, "embree", 1, level=messages.get_level())
    set_level(False, False)  # another process begins so
    common.tools(setting)
    assert messages.get_level() == messages.QUIET
    common.tools.cache_clear()
