"""Tracking, uncertain or lost: what a tracker says of an object, with hysteresis.

Never sees an image and never moves a pose.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum


class TrackingState(StrEnum):
    """What is known of an object in a frame."""

    TRACKING = "tracking"  # the pose is believed
    UNCERTAIN = "uncertain"  # there is a pose; it may be wrong
    LOST = "lost"  # no pose: the object is out of view, covered, or somewhere else


@dataclass(frozen=True)
class StateConfig:
    """When a state changes; probabilities are those that a pose is right.

    Args:
        confirmed: probability from which an object is tracked.
        doubted: probability below which a tracked object becomes uncertain. Between the two the
            state stays what it was.
        rejected: probability below which a frame counts as one without the object.
        frames_to_lose: so many such frames in a row, and the object is lost.
        frames_to_find: so many confirmed frames in a row, and an object that was found again is
            tracked; until then it is uncertain.
    """

    confirmed: float = 0.6
    doubted: float = 0.4
    rejected: float = 0.25
    frames_to_lose: int = 3
    frames_to_find: int = 1


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
    ['tracking', 'uncertain', 'uncertain', 'lost', 'tracking']
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
        state = self.state
        if self._rejected >= config.frames_to_lose or (
            state is TrackingState.LOST and probability < config.doubted
        ):
            state = TrackingState.LOST
        elif self._confirmed >= (config.frames_to_find if state is not TrackingState.TRACKING else 1):
            state = TrackingState.TRACKING
        elif probability < config.doubted or state is TrackingState.LOST:
            state = TrackingState.UNCERTAIN
        if state is not self.state or not self.changes:
            self.changes.append(StateChange(self._frame, state))
        self.state = state
        return state

    def events(self) -> list[dict[str, int | str | None]]:
        """Stretches of one state: `state`, `first` and `last` frame; the last one is open (null)."""
        ends: list[int | None] = [change.frame - 1 for change in self.changes[1:]]
        return [
            {"state": str(change.state), "first": change.frame, "last": end}
            for change, end in zip(self.changes, [*ends, None], strict=True)
        ]
