"""Tracking, uncertain or lost: what a tracker says of an object, with hysteresis.

Never sees an image and never changes a pose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum

from ..config import StateConfig


class TrackingState(StrEnum):
    """What is known of an object in a frame."""

    TRACKING = "tracking"  # the pose is probably right
    UNCERTAIN = "uncertain"  # there is a pose; it may be wrong
    LOST = "lost"  # no pose: the object is out of view, covered, or somewhere else


def probability_of(config: StateConfig, confidence: float, agreement: float) -> float:
    """That a pose is right, by the network's confidence and the contour's agreement, in [0, 1]."""
    total = config.intercept + config.confidence * confidence + config.agreement * agreement
    return 1 / (1 + math.exp(-total))


@dataclass(frozen=True)
class StateChange:
    """An object's state from a frame on."""

    frame: int
    state: TrackingState


@dataclass
class StateMachine:
    """The state of one object, frame by frame.

    >>> machine = StateMachine(StateConfig(frames_to_lose=2))
    >>> [str(machine.update(p)) for p in (0.9, 0.2, 0.1, 0.1, 0.9)]
    ['tracking', 'uncertain', 'lost', 'lost', 'tracking']
    """

    config: StateConfig = field(default_factory=StateConfig)
    state: TrackingState = TrackingState.TRACKING
    changes: list[StateChange] = field(default_factory=list)
    _frame: int = -1
    _rejected: int = 0
    _confirmed: int = 0

    def update(self, probability: float) -> TrackingState:
        """The state in the next frame, in which the pose is right with this probability.

        0 for a frame without a pose.
        """
        config = self.config
        self._frame += 1
        self._rejected = self._rejected + 1 if probability < config.rejected else 0
        self._confirmed = self._confirmed + 1 if probability >= config.confirmed else 0
        state = self._next(probability)
        if state is not self.state or not self.changes:
            self.changes.append(StateChange(self._frame, state))
        self.state = state
        return state

    def _next(self, probability: float) -> TrackingState:
        tracked, lost = self.state is TrackingState.TRACKING, self.state is TrackingState.LOST
        if self._rejected >= self.config.frames_to_lose:
            return TrackingState.LOST
        if lost and probability < self.config.doubted:
            return TrackingState.LOST
        if self._confirmed >= (1 if tracked else self.config.frames_to_find):
            return TrackingState.TRACKING
        if tracked and probability >= self.config.doubted:
            return TrackingState.TRACKING
        return TrackingState.UNCERTAIN

    def events(self) -> list[dict[str, int | str | None]]:
        """Stretches of one state: `state`, `first` and `last` frame; the last one is open."""
        ends: list[int | None] = [change.frame - 1 for change in self.changes[1:]]
        return [
            {"state": str(change.state), "first": change.frame, "last": end}
            for change, end in zip(self.changes, [*ends, None], strict=True)
        ]
