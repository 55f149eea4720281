"""Boards: which can be printed, and what is seen where there is none."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from moveit6d.camera_calibration import Board
from moveit6d.errors import InputError
from tests.support.board_photos import HEIGHT, WIDTH


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Board("charuco", 2, 7), "3 to 50"),
        (lambda: Board("charuco", 5, 7, "nonsense"), "4x4_50"),
        (lambda: Board("charuco", 20, 30, "4x4_50"), "more markers"),
    ],
)
def test_impossible_boards_are_refused(make: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        make()


def test_a_picture_without_a_board_has_no_corners() -> None:
    random = np.random.default_rng(0)
    noise = random.integers(0, 255, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    assert Board("charuco", 5, 7).find(noise) is None
    assert Board("chessboard", 6, 7).find(np.full_like(noise, 128)) is None
