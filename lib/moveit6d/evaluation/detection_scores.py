"""Detections scored against true poses: how often right, how often claimed where nothing is.

Never detects by itself and never chooses a setting.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..datasets.sequences import Sequence as Video
from ..datasets.video import Image
from ..errors import InputError
from ..estimation import PoseDetector
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from . import metrics
from .tables import markdown, percent
from .track_scores import EvaluationPoints

MakeDetector = Callable[[Mesh, Camera], PoseDetector]
FIELD_OF_VIEW = 0.96  # focal length of a photo's pretended camera, in longer sides


@dataclass(frozen=True)
class DetectedFrame:
    """One frame in which an object was looked for.

    `error` is ADD(-S) of the most probable pose in diameters, infinite if there is none;
    `probability` what the detector gives that pose; `group` what tables group by. A frame that
    could not be read has neither a pose nor a time (`milliseconds` None).
    """

    group: str
    name: str
    frame: int
    error: float
    probability: float
    milliseconds: float | None

    @property
    def right(self) -> bool:
        """Whether ADD(-S) is below a tenth of the diameter."""
        return self.error < metrics.ADD_LIMIT


def detect_in_sequence(
    video: Video, frames: Sequence[int], make: MakeDetector
) -> Iterator[DetectedFrame]:
    """Look for a sequence's object in those of some frames whose pose is known, from nothing.

    One that cannot be read, or that the video should have and does not, is found nothing in.
    """
    wanted = {frame for frame in frames if frame in video.truth}
    if not wanted:
        return
    mesh = video.load_mesh()
    surface = EvaluationPoints.of(mesh, symmetric=video.symmetric)
    detector = make(mesh, video.camera)
    detector.prepare()
    last = max(wanted)
    for frame in video.open():
        if frame.index > last:
            break
        if frame.index not in wanted or frame.image is None:
            continue
        wanted.discard(frame.index)
        begin = time.perf_counter()
        best = detector.detect(frame.image).best
        spent = (time.perf_counter() - begin) * 1e3
        error = float("inf")
        if best is not None:
            true = video.truth[frame.index]
            add = metrics.add_s(best.pose, true, surface.points, surface.symmetric)
            error = float(add) / surface.diameter
        probability = 0.0 if best is None else best.probability
        yield DetectedFrame(video.level, video.name, frame.index, error, probability, spent)
        if frame.index == last:
            break
    for index in sorted(wanted):
        yield DetectedFrame(video.level, video.name, index, float("inf"), 0.0, None)


def detect_in_photos(
    photos: Sequence[tuple[str, Image]], mesh: Mesh, make: MakeDetector
) -> Iterator[DetectedFrame]:
    """Look for an object in photos without it: every pose is wrong."""
    for number, (name, photo) in enumerate(photos):
        detector = make(mesh, pretended_camera(photo))
        detector.prepare()
        begin = time.perf_counter()
        probability = detector.detect(photo).probability
        spent = (time.perf_counter() - begin) * 1e3
        yield DetectedFrame(mesh.name, name, number, float("inf"), probability, spent)


def pretended_camera(photo: Image) -> Camera:
    """A camera of an ordinary field of view for a photo (H, W, 3) of unknown origin."""
    height, width = photo.shape[:2]
    focal = FIELD_OF_VIEW * max(height, width)
    return Camera(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)


def detection_table(frames: Sequence[DetectedFrame], accepted: float) -> str:
    """A line a group, and one for all, as Markdown, and how many frames could not be read.

    `InputError` if there is no frame that could be read.
    """
    if not frames:
        raise InputError("there is no frame to score; give at least one with a true pose.")
    unread = sum(one.milliseconds is None for one in frames)
    if unread == len(frames):
        raise InputError(
            f"none of the {unread} frames to score can be read, the first of them frame "
            f"{frames[0].frame} of {frames[0].name}; give a whole copy of the data."
        )
    groups: dict[str, list[DetectedFrame]] = {}
    for one in frames:
        groups.setdefault(one.group, []).append(one)
    groups["all"] = list(frames)
    head = ("group", "frames", "ADD(-S) < 10 %", "claimed", "claimed and right", "median ms")
    table = markdown(head, [_line(name, some, accepted) for name, some in groups.items()])
    if not unread:
        return table
    return (
        f"{table}\n\n{unread} of {len(frames)} frames could not be read; they count as not found."
    )


def _line(name: str, frames: Sequence[DetectedFrame], accepted: float) -> list[str]:
    claimed = [one for one in frames if one.probability >= accepted]
    times = [one.milliseconds for one in frames if one.milliseconds is not None]
    right = sum(one.right for one in claimed) / len(claimed) if claimed else float("nan")
    return [
        name,
        str(len(frames)),
        percent(float(np.mean([one.right for one in frames]))),
        percent(len(claimed) / len(frames)),
        percent(right) if claimed else "–",
        f"{np.median(times):.0f}" if times else "–",
    ]
