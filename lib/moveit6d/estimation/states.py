"""Tracking, uncertain or lost: what a tracker says of an object, with hysteresis.

Never sees an image and never moves a pose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import StrEnum


class TrackingState(StrEnum):
    """What is known of an object in a frame."""

    TRACKING = "tracking"  # the pose is believed
    UNCERTAIN = "uncertain"  # there is a pose; it may be wrong
    LOST = "lost"  # no pose: the object is out of view, covered, or somewhere else


@dataclass(frozen=True)
class StateConfig:
    """When a state changes.

    The probability that a pose is right is a logistic regression on the network's confidence and on
    the contour's agreement with the colours of earlier frames, which the network never saw. It was
    fitted on tracks of made sequences in which the object goes away and comes back, of training
    meshes that were held out.

    Args:
        confidence: weight of the network's confidence.
        agreement: weight of the contour's agreement, a share.
        intercept: of the regression.
        confirmed: probability from which an object is tracked.
        doubted: probability below which a tracked object becomes uncertain. Between the two the
            state stays what it was.
        rejected: probability below which a frame counts as one without the object.
        frames_to_lose: so many such frames in a row, and the object is lost.
        frames_to_find: so many confirmed frames in a row, and an object that was found again is
            tracked; until then it is uncertain.
    """

    confidence: float = 11.5
    agreement: float = 4.5
    intercept: float = -9.8
    confirmed: float = 0.5
    doubted: float = 0.3
    rejected: float = 0.25
    frames_to_lose: int = 3
    frames_to_find: int = 1

    def probability(self, confidence: float, agreement: float) -> float:
        """That a pose is right; both arguments in [0, 1]."""
        total = self.intercept + self.confidence * confidence + self.agreement * agreement
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
    >>> [str(machine.update(p)) for p in (0.9, 0.3, 0.1, 0.1, 0.9)]
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
