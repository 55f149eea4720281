"""Takes a tracker through a video and says for every frame what came out.

Never resets the tracker and never shows it a true pose.
"""

from __future__ import annotations

import random
from array import array
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from ..config import TrackerConfig
from ..datasets.pose_files import PoseRow
from ..datasets.video import VideoFrame
from ..errors import InputError
from ..estimation.recovery import LOST
from ..estimation.states import Event, TrackingState, add_event
from .metrics import LOST_RUN

if TYPE_CHECKING:
    from ..estimation import PoseTracker, TrackingResult

    AnyTracker = PoseTracker[TrackingResult] | PoseTracker[list[TrackingResult]]

LOW_CONFIDENCE = TrackerConfig().low_confidence
FAILED = "failed"
KEPT_FAILURES = 100
# A live video has no end: an hour of times, and more events than anyone reads.
KEPT_TIMES, KEPT_EVENTS = 100_000, 10_000


@dataclass(frozen=True)
class TrackedFrame:
    """One frame and the row of poses.csv for it; `error` says why a frame has no pose.

    Of several objects these are the first one's, and `others` hold those of the others.
    """

    frame: VideoFrame
    row: PoseRow
    error: str | None = None
    others: tuple[TrackedFrame, ...] = ()

    @property
    def confident(self) -> bool:
        """Whether there is a confident pose (`is_confident`)."""
        return is_confident(self.row)


def is_confident(row: PoseRow) -> bool:
    """Whether a row has a confident pose: by its state, of others' tracks by the confidence."""
    if row.pose is None:
        return False
    if row.state:
        return row.state == TrackingState.TRACKING
    return (row.confidence or 0.0) >= LOW_CONFIDENCE


def calibrating(tracker: AnyTracker, frames: Iterable[VideoFrame]) -> Iterator[VideoFrame]:
    """The frames; the tracker calibrates from the first, in which its start pose is exact.

    A first frame that cannot serve is passed on like the others, for `run_tracker` to say why.
    """
    for number, frame in enumerate(frames):
        if number == 0 and frame.image is not None:
            with suppress(InputError):
                tracker.calibrate(frame.image)
        yield frame


def run_tracker(
    tracker: AnyTracker, frames: Iterable[VideoFrame], names: Sequence[str] = ("",)
) -> Iterator[TrackedFrame]:
    """The results of each frame, in order. A bad frame gives rows without a pose; all goes on.

    `names` are those of the tracker's objects.
    """
    for frame in frames:
        found = tracker.update(frame.image)
        results = found if isinstance(found, list) else [found]
        steps = [_step(frame, result, name) for result, name in zip(results, names, strict=True)]
        yield replace(steps[0], others=tuple(steps[1:]))


def _step(frame: VideoFrame, result: TrackingResult, name: str) -> TrackedFrame:
    """What came out for one object; a frame that could not be used took no time."""
    unread = frame.image is None
    failed = unread or result.pose is None or result.stopped_by.value == FAILED
    error = (frame.error or "no image.") if unread else (result.error or "no pose.")
    row = PoseRow(
        frame=frame.index,
        image=frame.name,
        pose=None if failed else result.pose,
        iterations=None if failed else result.iterations,
        stopped_by=result.stopped_by.value,
        confidence=None if failed else result.confidence,
        milliseconds=result.milliseconds or None,
        object=name,
        state=str(result.state),
        probability=None if failed else result.probability,
    )
    return TrackedFrame(frame, row, error if failed else None)


def _says_lost(error: str) -> bool:
    """Whether a reason only says what the state says; resumed tracks write it in lower case."""
    return error.casefold() == LOST.casefold()


def failures_in(content: Mapping[str, Any]) -> dict[int, str]:
    """Why frames have no pose, by frame: what a file of facts says under `failures`."""
    return {int(one["frame"]): str(one["error"]) for one in content.get("failures", ())}


@dataclass
class TrackSummary:
    """What a report says of a track, gathered frame by frame in little memory.

    `lost_from` is the first frame in which the object is lost; of a track without states the first
    of so many without a confident pose that it may be.
    Of more than `KEPT_EVENTS` events the last are kept, of more than `KEPT_TIMES` times a random
    choice, from which the median is.
    """

    frames: int = 0
    failed: int = 0
    states: dict[str, int] = field(default_factory=dict)
    events: list[Event] = field(default_factory=list)
    failures: list[dict[str, object]] = field(default_factory=list)
    milliseconds: array[float] = field(default_factory=lambda: array("d"))
    lost_from: int | None = None
    _low_confidence_run: int = 0
    _timed: int = 0
    _total_milliseconds: float = 0.0
    _random: random.Random = field(default_factory=lambda: random.Random(0))

    def add(self, step: TrackedFrame) -> None:
        """Take note of one more frame."""
        told = step.error is None or _says_lost(step.error)
        if not told and len(self.failures) < KEPT_FAILURES:
            self.failures.append({"frame": step.frame.index, "error": step.error})
        self.add_row(step.row)

    def add_row(self, row: PoseRow) -> None:
        """Take note of one more frame of which only the row is known."""
        self.frames += 1
        self._add_state(row.state, row.frame)
        self.failed += row.pose is None
        if row.milliseconds is not None:
            self._add_time(row.milliseconds)
        self._low_confidence_run = 0 if is_confident(row) else self._low_confidence_run + 1
        if self.lost_from is None:
            self.lost_from = self._lost_from(row)

    def _lost_from(self, row: PoseRow) -> int | None:
        """Where the object is lost from, if this frame says so."""
        if row.state:
            return row.frame if row.state == TrackingState.LOST else None
        return row.frame - LOST_RUN + 1 if self._low_confidence_run == LOST_RUN else None

    def _add_time(self, milliseconds: float) -> None:
        """Keep a time, or let it take the place of another: each has the same chance to stay."""
        self._timed += 1
        self._total_milliseconds += milliseconds
        if len(self.milliseconds) < KEPT_TIMES:
            self.milliseconds.append(milliseconds)
        elif (place := self._random.randrange(self._timed)) < KEPT_TIMES:
            self.milliseconds[place] = milliseconds

    def _add_state(self, state: str, frame: int) -> None:
        """Count the state, and lengthen the event that it belongs to or begin one."""
        self.states[state] = self.states.get(state, 0) + 1
        add_event(self.events, state, frame)
        if len(self.events) > KEPT_EVENTS:
            del self.events[0]

    def facts(self) -> dict[str, object]:
        """As summary.json has it.

        `states` are numbers of frames, `events` says from which frame to which each state lasted.
        `failures` do not say again in which frames the object is lost.
        """
        times = self.milliseconds
        return {
            "frames": self.frames,
            "failed": self.failed,
            "states": self.states,
            "events": self.events,
            "mean_milliseconds": self._total_milliseconds / self._timed if times else None,
            "median_milliseconds": float(np.median(times)) if times else None,
            "lost_from_frame": self.lost_from,
            "failures": [one for one in self.failures if not _says_lost(str(one["error"]))],
        }
