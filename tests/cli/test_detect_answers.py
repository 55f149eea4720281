"""What is kept of what was found: rows, names of files, lines of the journal."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import torch

from moveit6d import Pose
from moveit6d.cli.detect_answers import (
    POINTS_ERROR,
    Answer,
    answer_line,
    answer_of,
    columns,
    pose_file,
    rows,
)
from moveit6d.datasets.pose_files import PoseWriter, read_poses, track_columns
from moveit6d.datasets.video import VideoFrame

POSE = Pose.from_rvec([0.1, 0.2, 0.3], [0, 0, 0.5])
FRAME = VideoFrame(4, "a.png", None)


def test_the_columns_are_those_of_tracks_and_the_instance_if_there_are_more() -> None:
    assert columns(1, 1) == track_columns(1)
    assert columns(2, 1) == track_columns(2)
    assert columns(2, 3)[-3:] == ("object", "instance", "state")


def test_instances_are_numbered_and_can_be_read_back(tmp_path: Path) -> None:
    answer = Answer(((POSE, 0.9, 3, "revisited"), (POSE, 0.7, 4, "stop_action")), 0.9, 20.0, {})
    with PoseWriter(tmp_path / "poses.csv", columns(2, 2)) as table:
        for row in (*rows(FRAME, "cup", answer), *rows(FRAME, "can", Answer((), 0.1))):
            table.write(row)
    lines = [line.split(",") for line in (tmp_path / "poses.csv").read_text().splitlines()]
    assert [line[-3:] for line in lines[1:]] == [
        ["cup", "0", "tracking"], ["cup", "1", "tracking"], ["can", "", "lost"],
    ]  # fmt: skip
    read = read_poses(tmp_path / "poses.csv")
    assert [row.object for row in read] == ["cup", "cup", "can"]
    assert [row.confidence for row in read] == [0.9, 0.7, 0.1]
    assert [row.stopped_by for row in read] == ["revisited", "stop_action", "failed"]


@pytest.mark.parametrize(
    ("answer", "state", "found"),
    [
        (Answer(((POSE, 0.9, 3, "stop_action"),), 0.9, 1.0, {}), "tracking", True),
        (Answer(((POSE, 0.0, 0, ""),), 0.0, 1.0, {POINTS_ERROR: 1.0}), "uncertain", False),
        (Answer((), 0.2, 1.0, {}), "lost", False),
        (Answer((), error="it is damaged."), "uncertain", False),
    ],
)
def test_only_what_the_image_confirms_is_found(answer: Answer, state: str, found: bool) -> None:
    assert [row.state for row in rows(FRAME, "", answer)] == [state]
    assert answer.found == found


def test_every_pose_has_a_file() -> None:
    names = [pose_file(name, number) for name in ("", "cup") for number in (0, 1)]
    assert names == ["pose.json", "pose_2.json", "pose_cup.json", "pose_cup_2.json"]


def test_a_journal_keeps_an_answer_exactly() -> None:
    answer = Answer(((POSE, 0.9, 3, "stop_action"),), 0.9, 1.0, {"poses": []})
    again = answer_of(json.loads(json.dumps(answer_line(answer))))
    ((pose, *more),) = again.poses
    assert torch.equal(pose.rotation, POSE.rotation) and more == [0.9, 3, "stop_action"]
    assert (again.best, again.facts) == (0.9, {"poses": []})
