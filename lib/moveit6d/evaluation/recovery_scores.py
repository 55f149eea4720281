"""Tracks of an object that goes away and comes back: is it found again, is the loss known?

Never tracks by itself. In each sequence a stretch of frames is replaced by other pictures while the
object's motion goes on.
"""

from __future__ import annotations

import random
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..datasets.pose_files import PoseRow
from ..datasets.video import Image, VideoFrame
from ..errors import InputError
from ..geometry.pose import Pose
from . import metrics
from .tables import markdown, percent
from .track_scores import EvaluationPoints

# Frames are counted from that of the start.
GONE = (40, 70)  # the first replaced frame and the first that is there again
PICTURE = 10  # frames that one other picture stays
SETTLED = 2  # frames after a change that are not scored as lost
FOUND_FROM = 80  # frame from which the object should have been found again
WRONG = 0.2  # of the diameter: a pose farther off that is claimed to be tracked is a false claim


def cut(
    frames: Iterable[VideoFrame], photos: Sequence[Image], seed: int, first: int = 0
) -> Iterator[VideoFrame]:
    """The frames with those of `GONE` replaced by photos, resized; `InputError` without a photo.

    `first` is the number of the start's frame.
    """
    if not photos:
        raise InputError("there is no other picture to cut in; give a folder of readable pictures.")
    return _cut(frames, photos, seed, first)


def _cut(
    frames: Iterable[VideoFrame], photos: Sequence[Image], seed: int, first: int
) -> Iterator[VideoFrame]:
    from PIL import Image as Pillow

    choice, photo = random.Random(seed), None
    for frame in frames:
        number = frame.index - first
        if frame.image is None or not GONE[0] <= number < GONE[1]:
            yield frame
            continue
        if photo is None or number % PICTURE == 0:
            height, width = frame.image.shape[:2]
            picked = Pillow.fromarray(choice.choice(photos)).resize((width, height))
            photo = np.array(picked)
        yield replace(frame, image=photo)


@dataclass(frozen=True)
class RecoveryScore:
    """Counts of one or more tracks: of frames that count for each share, how many are so.

    `found`: below 10 % of the diameter from frame `FOUND_FROM`; `known_lost`: state lost while the
    object is away; `false_claims`: of the frames in state tracking those in which the object is
    away or the pose off by more than `WRONG`; `known_tracked`: of the frames below 10 % those in
    state tracking.
    """

    found: tuple[int, int]
    known_lost: tuple[int, int]
    false_claims: tuple[int, int]
    known_tracked: tuple[int, int]

    def __add__(self, other: RecoveryScore) -> RecoveryScore:
        """Of both tracks together."""
        return RecoveryScore(*(
            (a[0] + b[0], a[1] + b[1])
            for a, b in zip(vars(self).values(), vars(other).values(), strict=True)
        ))  # fmt: skip


def score_recovery(
    rows: Mapping[int, PoseRow],
    truth: Mapping[int, Pose],
    surface: EvaluationPoints,
    first: int = 0,
) -> RecoveryScore:
    """Count the frames of one cut track; that of the start, `first`, does not count.

    Nor do frames without a true pose, but while the object is away, where none is needed.
    """
    found, lost, claims, tracked = ([0, 0] for _ in range(4))
    for frame, row in rows.items():
        number = frame - first
        if frame not in truth and not GONE[0] <= number < GONE[1]:
            continue
        error = float("inf")
        if row.pose is not None and frame in truth:
            add = metrics.add_s(row.pose, truth[frame], surface.points, surface.symmetric)
            error = float(add) / surface.diameter
        away = GONE[0] + SETTLED <= number < GONE[1]
        there = 0 < number < GONE[0] or number >= GONE[1]
        claimed, good = row.state == "tracking", there and error < metrics.ADD_LIMIT
        _count(found, number >= FOUND_FROM, error < metrics.ADD_LIMIT)
        _count(lost, away, row.state == "lost")
        _count(claims, claimed, away or (there and error > WRONG))
        _count(tracked, good, claimed)
    return RecoveryScore(*((a, b) for a, b in (found, lost, claims, tracked)))


def _count(pair: list[int], counts: bool, so: bool) -> None:
    pair[0] += counts and so
    pair[1] += counts


def recovery_table(scores: Mapping[str, RecoveryScore]) -> str:
    """A line a group, and one for all, as Markdown."""
    lines = dict(scores)
    if scores:
        total = RecoveryScore((0, 0), (0, 0), (0, 0), (0, 0))
        for one in scores.values():
            total += one
        lines["all"] = total
    head = ("group", "found again", "known lost", "false claims", "known tracked")
    return markdown(head, [
        [name, *(percent(a / b) if b else "–" for a, b in vars(score).values())]
        for name, score in lines.items()
    ])  # fmt: skip
