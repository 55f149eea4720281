"""Takes a tracker of one object through a video and says for every frame what came out.

Never resets the tracker and never shows it a true pose.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

from ..config import TrackerConfig
from ..datasets.pose_files import PoseRow
from ..datasets.video import VideoFrame
from ..errors import InputError
from .metrics import LOST_RUN

if TYPE_CHECKING:
    from ..estimation import PoseTracker, TrackingResult

LOW_CONFIDENCE = TrackerConfig().low_confidence
FAILED = "failed"
KEPT_FAILURES = 100


@dataclass(frozen=True)
class TrackedFrame:
    """One frame and the row of poses.csv for it; `error` says why a frame has no pose."""

    frame: VideoFrame
    row: PoseRow
    error: str | None = None

    @property
    def confident(self) -> bool:
        """Whether there is a pose that the tracker itself believes."""
        return self.row.pose is not None and (self.row.confidence or 0.0) >= LOW_CONFIDENCE


def calibrating(
    tracker: PoseTracker[TrackingResult], frames: Iterable[VideoFrame]
) -> Iterator[VideoFrame]:
    """The frames, from the first of which the tracker learns: its start pose is exact there.

    A first frame that it cannot learn from is passed on like the others, for `follow` to say why.
    """
    for number, frame in enumerate(frames):
        if number == 0 and frame.image is not None:
            with suppress(InputError):
                tracker.calibrate(frame.image)
        yield frame


def run_tracker(
    tracker: PoseTracker[TrackingResult], frames: Iterable[VideoFrame]
) -> Iterator[TrackedFrame]:
    """One step a frame, in order. A bad frame gives a row without a pose; the track goes on."""
    for frame in frames:
        if frame.image is None:
            yield TrackedFrame(frame, _failed(frame), frame.error or "no image.")
            continue
        result = tracker.update(frame.image)
        if result.pose is None or result.stopped_by.value == FAILED:
            yield TrackedFrame(frame, _failed(frame), result.error or "no pose.")
            continue
        row = PoseRow(
            frame=frame.index,
            image=frame.name,
            pose=result.pose,
            iterations=result.iterations,
            stopped_by=result.stopped_by.value,
            confidence=result.confidence,
            milliseconds=result.milliseconds,
        )
        yield TrackedFrame(frame, row)


@dataclass
class TrackSummary:
    """What a report says of a track, gathered frame by frame in little memory."""

    frames: int = 0
    failed: int = 0
    failures: list[dict[str, object]] = field(default_factory=list)
    milliseconds: list[float] = field(default_factory=list)
    lost_from: int | None = None
    _low_confidence_run: int = 0

    def add(self, step: TrackedFrame) -> None:
        """Take note of one more frame."""
        self.frames += 1
        if step.error is not None:
            self.failed += 1
            if len(self.failures) < KEPT_FAILURES:
                self.failures.append({"frame": step.frame.index, "error": step.error})
        if step.row.milliseconds is not None:
            self.milliseconds.append(step.row.milliseconds)
        self._low_confidence_run = 0 if step.confident else self._low_confidence_run + 1
        if self._low_confidence_run == LOST_RUN and self.lost_from is None:
            self.lost_from = step.frame.index - LOST_RUN + 1

    def facts(self) -> dict[str, object]:
        """As summary.json has it. `lost_from_frame` is a guess from the confidence, or null."""
        times = self.milliseconds
        return {
            "frames": self.frames,
            "failed": self.failed,
            "mean_milliseconds": float(np.mean(times)) if times else None,
            "median_milliseconds": float(np.median(times)) if times else None,
            "lost_from_frame": self.lost_from,
            "failures": self.failures,
        }


def _failed(frame: VideoFrame) -> PoseRow:
    return PoseRow(frame=frame.index, image=frame.name, stopped_by=FAILED)
