"""What may have kept objects from being found."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from moveit6d import TrackerConfig
from moveit6d.cli.not_found import say_why
from moveit6d.datasets.pose_files import PoseRow
from moveit6d.evaluation.run_tracker import TrackSummary

BASE = TrackerConfig()
LIMITED = replace(BASE, recovery=replace(BASE.recovery, max_milliseconds=5.0))


def record(*rows: PoseRow) -> TrackSummary:
    found = TrackSummary()
    for row in rows:
        found.add_row(row)
    return found


NEVER = record(PoseRow(0, milliseconds=9.0, state="lost"))


def tracker(config: TrackerConfig, *objects: tuple[bool, bool]) -> Any:
    """Of objects that have colours or not, and of which a search has ended or not."""
    meshes = [SimpleNamespace(has_colours=coloured) for coloured, _ in objects]
    supervisors = [SimpleNamespace(check=object() if ended else None) for _, ended in objects]
    return SimpleNamespace(config=config, meshes=meshes, supervisors=supervisors)


@pytest.mark.parametrize(
    ("config", "coloured", "ended", "words"),
    [
        (BASE, True, True, ""),
        (BASE, True, False, ""),
        (BASE, False, True, "the mesh has no colours, which is the likely reason"),
        (LIMITED, True, True, ""),
        (LIMITED, True, False, "--max_milliseconds 5 is too short for it; give a larger value"),
    ],
)
def test_the_likely_reason_is_named(
    capsys: Any, config: TrackerConfig, coloured: bool, ended: bool, words: str
) -> None:
    say_why(tracker(config, (coloured, ended)), [NEVER], [""], [None])
    said = capsys.readouterr().err
    assert words in said and bool(said) == bool(words)


def test_of_several_those_are_named_that_were_never_found(scene: Any, capsys: Any) -> None:
    seen = record(PoseRow(0, pose=scene.pose(0), milliseconds=9.0, state="tracking"))
    unread = record(PoseRow(0, state="lost"))
    three = tracker(LIMITED, *[(False, False)] * 4)
    starts = [None, None, None, scene.pose(0)]
    say_why(three, [NEVER, seen, unread, NEVER], ["a", "b", "c", "d"], starts)
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 2 and "no search for a, d was finished" in said[0]
    assert "the meshes of a have no colours" in said[1]
