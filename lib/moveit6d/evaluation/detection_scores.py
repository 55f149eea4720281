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
    `probability` what the detector gives that pose; `group` what tables group by.
    """

    group: str
    name: str
    frame: int
    error: float
    probability: float
    milliseconds: float

    @property
    def right(self) -> bool:
        """Whether ADD(-S) is below a tenth of the diameter."""
        return self.error < metrics.ADD_LIMIT


def detect_in_sequence(
    video: Video, frames: Sequence[int], make: MakeDetector
) -> Iterator[DetectedFrame]:
    """Look for a sequence's object in some of its frames, from nothing."""
    mesh = video.load_mesh()
    surface = EvaluationPoints.of(mesh, symmetric=video.symmetric)
    detector = make(mesh, video.camera)
    detector.prepare()
    wanted = {frame for frame in frames if frame in video.truth}
    for frame in video.open():
        if frame.index not in wanted or frame.image is None:
            continue
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
        if frame.index >= max(wanted):
            return


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
    """A line a group, and one for all, as Markdown."""
    groups: dict[str, list[DetectedFrame]] = {}
    for one in frames:
        groups.setdefault(one.group, []).append(one)
    groups["all"] = list(frames)
    head = ("group", "frames", "ADD(-S) < 10 %", "claimed", "claimed and right", "median ms")
    return markdown(head, [_line(name, some, accepted) for name, some in groups.items()])


def _line(name: str, frames: Sequence[DetectedFrame], accepted: float) -> list[str]:
    claimed = [one for one in frames if one.probability >= accepted]
    right = sum(one.right for one in claimed) / len(claimed) if claimed else float("nan")
    return [
        name,
        str(len(frames)),
        percent(float(np.mean([one.right for one in frames]))),
        percent(len(claimed) / len(frames)),
        percent(right) if claimed else "–",
        f"{np.median([one.milliseconds for one in frames]):.0f}",
    ]
