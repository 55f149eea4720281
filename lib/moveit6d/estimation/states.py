"""Tracking, uncertain or lost: what a tracker says of an object, with hysteresis.

Never sees an image and never changes a pose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TypedDict

from ..config import StateConfig

CERTAIN = 1e-4  # a confidence nearer to 0 or 1 says no more


class TrackingState(StrEnum):
    """What is known of an object in a frame."""

    TRACKING = "tracking"  # the pose is probably right
    UNCERTAIN = "uncertain"  # the pose may be wrong; there is none if the frame was of no use
    LOST = "lost"  # no pose: the object is out of view, covered, or somewhere else


class Event(TypedDict):
    """A state that lasted from one frame to another."""

    state: str
    first: int
    last: int


def add_event(events: list[Event], state: str, frame: int) -> None:
    """Take note of a frame's state: it lengthens the last of the events or begins another."""
    if events and events[-1]["state"] == state:
        events[-1]["last"] = frame
    else:
        events.append({"state": state, "first": frame, "last": frame})


def log_odds(confidence: float) -> float:
    """Of a confidence, which is bounded first."""
    kept = min(max(confidence, CERTAIN), 1 - CERTAIN)
    return math.log(kept / (1 - kept))


def from_log_odds(value: float) -> float:
    """The probability that has these log odds."""
    return 1 / (1 + math.exp(-value))


def probability_of(
    config: StateConfig, confidence: float, agreement: float, coloured: bool = True
) -> float:
    """That a pose is right, by the network's confidence and the contour's agreement, in [0, 1].

    `coloured` says whether the mesh has colours (`Mesh.has_colours`).
    """
    if coloured:
        return from_log_odds(
            config.intercept + config.confidence * confidence + config.agreement * agreement
        )
    return from_log_odds(
        config.uncoloured_intercept
        + config.uncoloured_confidence * log_odds(confidence)
        + config.uncoloured_agreement * agreement
    )


@dataclass
class StateMachine:
    """The state of one object, frame by frame.

    >>> machine = StateMachine(StateConfig(frames_to_lose=2))
    >>> [str(machine.update(p)) for p in (0.9, 0.2, 0.1, 0.1, 0.9)]
    ['tracking', 'uncertain', 'lost', 'lost', 'tracking']
    """

    config: StateConfig = field(default_factory=StateConfig)
    state: TrackingState = TrackingState.TRACKING
    _rejected: int = 0
    _confirmed: int = 0

    def update(self, probability: float) -> TrackingState:
        """The state in the next frame, in which the pose is right with this probability.

        0 for a frame without a pose.
        """
        config = self.config
        self._rejected = self._rejected + 1 if probability < config.rejected else 0
        self._confirmed = self._confirmed + 1 if probability >= config.confirmed else 0
        self.state = self._next(probability)
        return self.state

    def _next(self, probability: float) -> TrackingState:
        tracked, lost = self.state is TrackingState.TRACKING, self.state is TrackingState.LOST
        if self._rejected >= self.config.frames_to_lose:
            return TrackingState.LOST
        if lost and probability < self.config.rejected:
            return TrackingState.LOST
        if self._confirmed >= (1 if tracked else self.config.frames_to_find):
            return TrackingState.TRACKING
        if tracked and probability >= self.config.doubted:
            return TrackingState.TRACKING
        return TrackingState.UNCERTAIN
