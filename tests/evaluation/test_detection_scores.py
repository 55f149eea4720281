"""Scores of detections: the table of shares, the pretended camera of a photo."""

from __future__ import annotations

import math

import numpy as np
import pytest

from moveit6d.evaluation.detection_scores import (
    DetectedFrame,
    detection_table,
    pretended_camera,
)


def frame(group: str, error: float, probability: float) -> DetectedFrame:
    return DetectedFrame(group, "a", 0, error, probability, 100.0)


def test_the_table_counts_right_and_claimed() -> None:
    frames = [
        frame("easy", 0.05, 0.9),
        frame("easy", 0.2, 0.7),
        frame("hard", 0.09, 0.3),
        frame("hard", math.inf, 0.0),
    ]
    assert [one.right for one in frames] == [True, False, True, False]
    lines = [line.split("|") for line in detection_table(frames, 0.5).splitlines()]
    cells = {line[1].strip(): [cell.strip() for cell in line[2:-1]] for line in lines}
    assert cells["easy"] == ["2", "50.0 %", "100.0 %", "50.0 %", "100"]
    assert cells["hard"] == ["2", "50.0 %", "0.0 %", "–", "100"]
    assert cells["all"] == ["4", "50.0 %", "50.0 %", "50.0 %", "100"]


def test_a_photo_gets_an_ordinary_camera() -> None:
    camera = pretended_camera(np.zeros((200, 300, 3), np.uint8))
    assert (camera.width, camera.height) == (300, 200)
    degrees = 2 * math.degrees(math.atan(150 / camera.fx))
    assert degrees == pytest.approx(55, abs=3)
