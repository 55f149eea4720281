"""Result files in BOP's format: scene_id,im_id,obj_id,score,R,t,time.

Never scores and never opens a data set. Millimetres become metres when reading and millimetres
again when writing.
"""

from __future__ import annotations

import csv
import math
import statistics
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..checks import LARGEST_WHOLE, listed, numbers
from ..errors import InputError
from ..geometry.pose import Pose
from ..io import read_text, replacing

RESULT_HEADER = ("scene_id", "im_id", "obj_id", "score", "R", "t", "time")
NEAREST = 0.02  # metres: objects that are nearer to the camera are a mistake of the unit


@dataclass(frozen=True)
class Estimate:
    """One line of a BOP result file: a pose (metres) with its score; `seconds` is −1 if unknown.

    `seconds` is the time of the whole image, the same on all lines of that image.
    """

    scene: int
    image: int
    object: int
    score: float
    pose: Pose
    seconds: float = -1.0


def read_results(path: str | Path) -> list[Estimate]:
    """All lines of a BOP result file in their order, the first of which may name the columns.

    An empty file is an `InputError`, and so is one whose translations are metres.
    """
    path = Path(path)
    try:
        rows = list(csv.reader(read_text(path).splitlines()))
    except csv.Error as error:
        raise InputError(f"{path} cannot be read: {error}.") from error
    first = tuple(cell.strip() for cell in rows[0]) if rows else ()
    titled = first == RESULT_HEADER
    if not titled and not (len(first) == len(RESULT_HEADER) and first[0][:1].isdigit()):
        raise InputError(f"{path}: its first line must be {','.join(RESULT_HEADER)}.")
    rows = rows[1:] if titled else rows
    found = [_estimate(row, f"{path}, row {n}") for n, row in enumerate(rows, 1) if row]
    if not found:
        raise InputError(f"{path} holds no estimate.")
    _check_unit(path, found)
    return found


def _check_unit(path: Path, found: list[Estimate]) -> None:
    """Refuse translations in metres; zeros, which some write for nothing found, say nothing."""
    lengths = [float(estimate.pose.translation.norm()) for estimate in found]
    middle = statistics.median([length for length in lengths if length > 0] or [math.inf])
    if middle < NEAREST:
        raise InputError(
            f"{path}: its translations are {1000 * middle:.3g} mm long, which looks like metres; "
            "BOP's are millimetres: multiply t by 1000."
        )


def write_results(path: str | Path, estimates: Iterable[Estimate]) -> None:
    """Write a BOP result file, atomically, in the order given."""
    with replacing(Path(path)) as temporary, temporary.open("w", encoding="utf-8") as file:
        file.write(",".join(RESULT_HEADER) + "\n")
        for e in estimates:
            rotation = " ".join(f"{value:.10g}" for value in e.pose.rotation.reshape(9).tolist())
            shift = " ".join(f"{1000 * value:.10g}" for value in e.pose.translation.tolist())
            seconds = "-1" if e.seconds < 0 else f"{e.seconds:.6f}"
            file.write(
                f"{e.scene},{e.image},{e.object},{e.score:.6f},{rotation},{shift},{seconds}\n"
            )


def by_image(estimates: Iterable[Estimate]) -> Iterator[tuple[tuple[int, int], list[int]]]:
    """Row numbers (from 0) of every (scene, image), in order of first appearance."""
    places: dict[tuple[int, int], list[int]] = {}
    for index, estimate in enumerate(estimates):
        places.setdefault((estimate.scene, estimate.image), []).append(index)
    yield from places.items()


def _estimate(row: list[str], where: str) -> Estimate:
    if len(row) != len(RESULT_HEADER):
        raise InputError(f"{where}: {len(RESULT_HEADER)} fields expected, found {len(row)}.")
    try:
        scene, image, item = (_identity(cell) for cell in row[:3])
        score, seconds = float(row[3]), float(row[6])
        rotation = [float(cell) for cell in row[4].split()]
        shift = [float(cell) for cell in row[5].split()]
    except ValueError as error:
        raise InputError(f"{where}: {error}.") from None
    if not math.isfinite(score):
        raise InputError(f"{where}: the score must be a finite number, found {row[3][:40]}.")
    if not math.isfinite(seconds):
        raise InputError(f"{where}: the time must be a finite number, found {row[6][:40]}.")
    return Estimate(scene, image, item, score, metric_pose(rotation, shift, where), seconds)


def _identity(cell: str) -> int:
    """A scene's, image's or object's number, also one that a table program wrote as 1.0."""
    value = float(cell)
    if not (value.is_integer() and 0 <= value <= LARGEST_WHOLE):
        raise ValueError(f"{cell.strip()[:40]!r} is no number of a scene, image or object")
    return int(value)


def metric_pose(rotation: Any, millimetres: Any, where: str) -> Pose:
    """A pose in metres of BOP's nine numbers of a rotation and three in millimetres."""
    turn, shift = listed(rotation, f"{where}: R"), listed(millimetres, f"{where}: t")
    if len(turn) != 9 or len(shift) != 3:
        raise InputError(
            f"{where}: R must have 9 numbers and t 3, found {len(turn)} and {len(shift)}."
        )
    metres = [value / 1000 for value in numbers(shift, 3, f"{where}: t")]
    return Pose.checked(numbers(turn, 9, f"{where}: R"), metres, where=where)
