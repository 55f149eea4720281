"""Scores of detections: the table of shares, the pretended camera of a photo."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from moveit6d.datasets.sequences import read_sequence
from moveit6d.errors import InputError
from moveit6d.evaluation.detection_scores import (
    DetectedFrame,
    detect_in_sequence,
    detection_table,
    pretended_camera,
)


def frame(
    group: str, error: float, probability: float, milliseconds: float | None = 100.0
) -> DetectedFrame:
    return DetectedFrame(group, "a", 0, error, probability, milliseconds)


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


def test_a_frame_that_cannot_be_read_counts_as_not_found() -> None:
    good = [frame("easy", 0.05, 0.9), frame("easy", 0.05, 0.9)]
    text = detection_table([*good, frame("hard", math.inf, 0.0, None)], 0.5)
    lines = [line.split("|") for line in text.splitlines() if line.startswith("|")]
    cells = {line[1].strip(): [cell.strip() for cell in line[2:-1]] for line in lines}
    assert cells["hard"] == ["1", "0.0 %", "0.0 %", "–", "–"]
    assert cells["all"] == ["3", "66.7 %", "66.7 %", "100.0 %", "100"]
    assert text.splitlines()[-1].startswith("1 of 3 frames could not be read")
    assert "could not be read" not in detection_table(good, 0.5)


def test_nothing_to_score_is_one_sentence() -> None:
    with pytest.raises(InputError, match="no frame to score"):
        detection_table([], 0.3)
    with pytest.raises(InputError, match=r"none of the 1 frames to score can be read.* 0 of a"):
        detection_table([frame("easy", math.inf, 0.0, None)], 0.3)


class Blind:
    """Stands for a detector: counts the images and finds nothing in them."""

    def __init__(self) -> None:
        self.images = 0

    def prepare(self) -> None:
        """Nothing to do."""

    def detect(self, image: Any) -> Any:
        self.images += 1
        return SimpleNamespace(best=None)


def test_frames_that_cannot_be_read_or_are_missing_are_told_apart(
    make_sequence: Callable[..., Any],
) -> None:
    made, blind = make_sequence("easy_00", frames=4), Blind()
    (made.folder / "frames" / "000001.png").write_bytes(b"no picture")
    (video,) = read_sequence(made.folder)
    truth = {**video.truth, 9: video.start}
    found = list(detect_in_sequence(
        replace(video, truth=truth), [0, 1, 2, 5, 9], lambda *_: blind  # type: ignore[arg-type,return-value]
    ))  # fmt: skip
    assert [one.frame for one in found] == [0, 2, 1, 9] and blind.images == 2
    assert [one.milliseconds is None for one in found] == [False, False, True, True]


def test_a_photo_gets_an_ordinary_camera() -> None:
    camera = pretended_camera(np.zeros((200, 300, 3), np.uint8))
    assert (camera.width, camera.height) == (300, 200)
    degrees = 2 * math.degrees(math.atan(150 / camera.fx))
    assert degrees == pytest.approx(55, abs=3)
