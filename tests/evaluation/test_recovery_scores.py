"""Cut sequences: which frames are replaced, and what counts for which share."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from moveit6d import Mesh, Pose
from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.video import VideoFrame
from moveit6d.errors import InputError
from moveit6d.evaluation.recovery_scores import (
    FOUND_FROM,
    GONE,
    RecoveryScore,
    cut,
    recovery_table,
    score_recovery,
)
from moveit6d.evaluation.track_scores import EvaluationPoints

RIGHT = Pose(torch.eye(3, dtype=torch.float64), torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64))
WRONG = Pose(RIGHT.rotation, torch.tensor([0.5, 0.0, 1.0], dtype=torch.float64))


def test_the_middle_becomes_other_pictures() -> None:
    black, white = np.zeros((6, 8, 3), np.uint8), np.full((20, 20, 3), 255, np.uint8)
    frames = [VideoFrame(k, str(k), black) for k in range(100)]
    found = list(cut(frames, [white], 0))
    replaced = [f.index for f in found if f.image is not None and f.image.max() > 0]
    assert replaced == list(range(*GONE)) and len(found) == 100
    assert found[GONE[0]].image.shape == (6, 8, 3)  # type: ignore[union-attr]


def test_frames_are_counted_from_that_of_the_start(brick: Mesh) -> None:
    black, white = np.zeros((6, 8, 3), np.uint8), np.full((6, 8, 3), 255, np.uint8)
    frames = [VideoFrame(k, str(k), black) for k in range(7, 107)]
    found = [f.index for f in cut(frames, [white], 0, 7) if f.image is white or f.image.max()]  # type: ignore[union-attr]
    assert found == list(range(GONE[0] + 7, GONE[1] + 7))
    rows = {k: PoseRow(k, pose=RIGHT, state="tracking") for k in range(7, 107)}
    score = score_recovery(rows, dict.fromkeys(rows, RIGHT), EvaluationPoints.of(brick), 7)
    early = {k - 7: PoseRow(k - 7, pose=RIGHT, state="tracking") for k in rows}
    assert score == score_recovery(early, dict.fromkeys(early, RIGHT), EvaluationPoints.of(brick))


def test_without_other_pictures_nothing_is_cut_and_it_is_said_at_once() -> None:
    with pytest.raises(InputError, match="no other picture"):
        cut([], [], 0)


@pytest.mark.parametrize(
    ("state", "gone_state", "expected"),
    [
        ("tracking", "lost", (1.0, 1.0, 0.0, 1.0)),
        ("uncertain", "lost", (1.0, 1.0, None, 0.0)),
        ("tracking", "tracking", (1.0, 0.0, 28 / 117, 1.0)),
    ],
)
def test_shares(state: str, gone_state: str, expected: tuple[Any, ...], brick: Mesh) -> None:
    rows = {}
    for k in range(120):
        away = GONE[0] <= k < GONE[1]
        settled = GONE[0] + 2 <= k < GONE[1]
        pose = None if settled and gone_state == "lost" else RIGHT
        rows[k] = PoseRow(k, pose=pose, state=gone_state if settled else "" if away else state)
    rows[0] = PoseRow(0, pose=RIGHT, state="")
    truth = dict.fromkeys(range(120), RIGHT)
    score = score_recovery(rows, truth, EvaluationPoints.of(brick))
    shares = [a / b if b else None for a, b in vars(score).values()]
    assert shares == pytest.approx(list(expected))


def test_a_pose_far_off_that_is_claimed_is_a_false_claim(brick: Mesh) -> None:
    rows = {k: PoseRow(k, pose=WRONG, state="tracking") for k in range(FOUND_FROM, 120)}
    truth = dict.fromkeys(rows, RIGHT)
    score = score_recovery(rows, truth, EvaluationPoints.of(brick))
    assert score.found == (0, 40) and score.false_claims == (40, 40)


def test_the_table_adds_up() -> None:
    one = RecoveryScore((1, 2), (3, 4), (0, 10), (9, 10))
    text = recovery_table({"easy": one, "hard": one})
    total = [cell.strip() for cell in text.splitlines()[-1].split("|")[1:-1]]
    assert total == ["all", "50.0 %", "75.0 %", "0.0 %", "90.0 %"]


def test_frames_without_a_true_pose_count_only_while_the_object_is_away(brick: Mesh) -> None:
    rows = {k: PoseRow(k, pose=RIGHT, state="tracking") for k in range(120)}
    known = [k for k in rows if not (10 <= k < 20 or GONE[0] <= k < GONE[1] or 80 <= k < 90)]
    score = score_recovery(rows, dict.fromkeys(known, RIGHT), EvaluationPoints.of(brick))
    assert score.found == (30, 30) and score.known_lost == (0, 28)
    assert score.false_claims == (28, 100) and score.known_tracked == (69, 69)
