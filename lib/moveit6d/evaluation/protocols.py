"""When a track is set back to the true pose: never, every 15 frames, or when it is lost.

Never scores. Two kinds of reset are published and both are kept as they are: RBOT judges the
tracker's own pose of a frame and then sets the tracker to the truth of that same frame; Laval gives
the tracker the true pose of a frame instead of letting it look, so that the frame has no error.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

from ..datasets.pose_files import PoseRow
from ..datasets.video import VideoFrame
from ..errors import InputError
from ..geometry.pose import Pose
from .metrics import (
    LAVAL_DEGREES,
    LAVAL_METRES,
    LAVAL_PATIENCE,
    laval_rotation_error,
    translation_error,
    within,
)
from .run_tracker import TrackedFrame, run_tracker

if TYPE_CHECKING:
    from ..estimation import PoseTracker, TrackingResult

# `stopped_by` of a frame whose pose was given, so that its error says nothing.
GIVEN = "reset"


@dataclass(frozen=True)
class Protocol:
    """A rule of resets.

    Args:
        name: what tables and options call it.
        reset_every: give the true pose in every frame whose number this divides; None never.
        reset_on: whose rule says that a track is lost; None no one's.
    """

    name: str
    reset_every: int | None = None
    reset_on: Literal["rbot", "laval"] | None = None

    def __post_init__(self) -> None:
        if self.reset_every is not None and self.reset_every < 1:
            raise InputError(f"Protocol: reset_every is {self.reset_every}, must be 1 or more.")


# One start pose and no help after it: the hardest, and what the project's own tables show.
NO_RESET = Protocol("none")
# The paper's: "reset the pose estimation with the annotated pose every 15 frames".
PAPER = Protocol("paper", reset_every=15)
# DLR-RM/3DObjectTracking, rbot_evaluator.cpp. No frame is given, so that all count.
RBOT = Protocol("rbot", reset_on="rbot")
# The Laval authors' test loop for their sequences `interaction_hard`; for all others they reset
# every 15 frames.
LAVAL = Protocol("laval", reset_on="laval")
PROTOCOLS = {protocol.name: protocol for protocol in (NO_RESET, PAPER, RBOT, LAVAL)}


def is_given(row: PoseRow) -> bool:
    """Whether the row's pose is the truth that the protocol gave instead of an estimate."""
    return row.reset and row.stopped_by == GIVEN


def follow_protocol(
    tracker: PoseTracker[TrackingResult],
    frames: Iterable[VideoFrame],
    truth: Mapping[int, Pose],
    protocol: Protocol,
) -> Iterator[TrackedFrame]:
    """One step a frame, as `run_tracker` makes them; `row.reset` marks frames with a reset.

    `frames` are those after the start frame; poses of `truth` (by frame number, mesh file's frame)
    are shown to the tracker only in a reset. As in the Laval authors' code the frames are counted
    from 0, so that the first of them is given already. Where the truth of a frame is not known, a
    reset waits for the next one that is; a frame without a pose is a bad one.
    """
    watch = _LavalWatch()
    due = False
    for number, frame in enumerate(frames):
        every = protocol.reset_every
        due = due or (every is not None and number % every == 0)
        true = truth.get(frame.index)
        if due and true is not None and _reset(tracker, true):
            due = False
            watch.bad = 0
            row = PoseRow(frame.index, frame.name, true, iterations=0, stopped_by=GIVEN, reset=True)
            yield TrackedFrame(frame, row)
            continue
        (step,) = run_tracker(tracker, (frame,))
        if true is not None and protocol.reset_on == "rbot":
            good = step.row.pose is not None and bool(within(step.row.pose, true))
            if not good and _reset(tracker, true):
                step = replace(step, row=replace(step.row, reset=True))
        elif true is not None and protocol.reset_on == "laval":
            due = due or watch.lost(step.row.pose, true)
        yield step


@dataclass
class _LavalWatch:
    """Counts bad frames in a row."""

    bad: int = 0

    def lost(self, pose: Pose | None, true: Pose) -> bool:
        """Take note of one more frame; whether there are more than 7 bad ones in a row."""
        good = pose is not None and (
            float(translation_error(pose, true)) <= LAVAL_METRES
            and float(laval_rotation_error(pose, true)) <= LAVAL_DEGREES
        )
        self.bad = 0 if good else self.bad + 1
        return self.bad > LAVAL_PATIENCE


def _reset(tracker: PoseTracker[TrackingResult], true: Pose) -> bool:
    """Set the tracker to the truth; False where the camera cannot see the object there."""
    try:
        tracker.reset(true)
    except InputError:
        return False
    return True
