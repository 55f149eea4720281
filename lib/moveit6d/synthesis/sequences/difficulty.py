"""How hard a synthetic sequence is: speeds, occlusion, light, clutter.

Never draws anything.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ...errors import InputError
from ...typing import Range


@dataclass(frozen=True)
class Difficulty:
    """How hard a sequence is. Ranges are drawn from once a sequence."""

    name: str
    pixels_per_frame: Range  # at the fastest moment, for frames 640 pixels wide
    degrees_per_frame: Range  # at the fastest moment
    occluded_frames: Range = (0.0, 0.0)  # share of the frames
    occlusion: Range = (0.15, 0.5)  # share of the object, at the most occluded moment
    shutter: Range = (0.2, 0.35)  # share of the frame time
    margin: float = 1.0  # of the object's radius kept inside the frame
    light_change: float = 0.05  # 0: steady, 1: wanders about and flickers
    clutter: tuple[int, int] = (0, 2)  # things lying about
    colour_similarity: float = 0.0  # how far the background takes on the object's colours
    board: Literal["", "h", "v"] = ""  # a board that hides part of the object in every frame …
    board_occlusion: float = 0.0  # … and which share of it


DIFFICULTIES = {
    difficulty.name: difficulty
    for difficulty in (
        Difficulty("easy", (2.2, 2.9), (1.0, 1.45)),
        Difficulty("occ", (2.2, 2.9), (1.0, 1.45), occluded_frames=(0.3, 0.6)),
        Difficulty(
            "medium", (5.0, 7.0), (2.5, 3.5), occluded_frames=(0.25, 0.35), occlusion=(0.2, 0.35),
            shutter=(0.3, 0.4), light_change=0.2,
        ),
        Difficulty(
            "fast", (20.0, 24.5), (8.0, 10.0), shutter=(0.3, 0.55), margin=0.7, light_change=0.3,
        ),
        Difficulty(
            "hard", (20.0, 24.5), (8.0, 10.0), occluded_frames=(0.25, 0.6), shutter=(0.3, 0.55),
            margin=0.8, light_change=1.0, clutter=(3, 7), colour_similarity=0.5,
        ),
    )
}  # fmt: skip


def find_difficulty(difficulty: str | Difficulty) -> Difficulty:
    """The difficulty of that name; a `Difficulty` stays what it is.

    Examples:
        >>> find_difficulty("easy").pixels_per_frame
        (2.2, 2.9)
    """
    if isinstance(difficulty, Difficulty):
        return difficulty
    if difficulty not in DIFFICULTIES:
        raise InputError(
            f"There is no difficulty {difficulty!r}; choose one of {', '.join(DIFFICULTIES)}."
        )
    return DIFFICULTIES[difficulty]
