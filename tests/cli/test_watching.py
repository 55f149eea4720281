"""What is said of a track while it runs: a bad start, a lost object, its return."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from moveit6d.cli.watching import Watcher


def frames(*confidences: float | str | None) -> Iterator[SimpleNamespace]:
    for index, given in enumerate(confidences):
        confidence, state = (None, given) if isinstance(given, str) else (given, "uncertain")
        yield SimpleNamespace(
            confident=(confidence or 0) >= 0.5,
            frame=SimpleNamespace(index=index),
            row=SimpleNamespace(confidence=confidence, state=state),
            error="lost." if state == "lost" else None,
        )


def said_of(capsys: pytest.CaptureFixture[str], *confidences: float | str | None) -> list[str]:
    watcher = Watcher()
    for step in frames(*confidences):
        watcher.see(step)  # type: ignore[arg-type]
    return capsys.readouterr().err.splitlines()


def test_a_bad_start_says_so_in_the_first_frames(capsys: pytest.CaptureFixture[str]) -> None:
    (line,) = said_of(capsys, 0.2, 0.3, 0.25, 0.2, *[0.1] * 30)
    assert "first 3 frames have confidence 0.25" in line and "start pose" in line
    assert said_of(capsys, 0.2, 0.9, *[0.8] * 10) == []
    late = said_of(capsys, None, None, None, 0.9)
    assert "confidence 0:" in late[0] and late[1].endswith("frame 3: found.")


def test_a_lost_object_is_named_once_and_its_return_too(capsys: pytest.CaptureFixture[str]) -> None:
    said = said_of(capsys, *[0.9] * 5, *[0.2] * 9, 0.9, *[0.1] * 25, 0.9)
    assert len(said) == 2
    assert "lost from frame 15 on" in said[0] and "frame 40: confident again" in said[1]
    said = said_of(capsys, *[0.9] * 5, 0.2, 0.2, *["lost"] * 25, 0.9, 0.9)
    assert len(said) == 2 and said[0].endswith("frame 7: lost.") and "frame 32" in said[1]


def test_an_object_that_is_looked_for_has_no_bad_start(capsys: pytest.CaptureFixture[str]) -> None:
    said = said_of(capsys, *["lost"] * 8, 0.9)
    assert [line.split(" ", 1)[1] for line in said] == ["frame 0: lost.", "frame 8: found."]
