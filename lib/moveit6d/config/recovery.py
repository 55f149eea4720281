"""Settings of what happens when an object is lost.

Never computes anything.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ..errors import InputError


@dataclass(frozen=True)
class StateConfig:
    """When the state of a tracked object changes.

    The probability that a pose is right is a logistic regression on the network's confidence and on
    the contour's agreement with the colours of earlier frames, which the network never saw. It was
    fitted on tracks of synthetic sequences in which the object goes away and comes back, of
    training meshes that were held out.

    Args:
        confidence: weight of the network's confidence.
        agreement: weight of the contour's agreement, a share.
        intercept: intercept of the regression.
        usual_agreement: the contour's agreement that is assumed where it is not measured (without
            contour refinement): the confidence alone decides then.
        confirmed: probability from which an object is tracked.
        doubted: probability below which a tracked object becomes uncertain. Between the two the
            state stays what it was.
        rejected: probability below which a frame counts as one without the object.
        frames_to_lose: so many rejected frames in a row, and the object is lost.
        frames_to_find: so many confirmed frames in a row, and an object that was found again is
            tracked; until then it is uncertain.
    """

    confidence: float = 7.3
    agreement: float = 3.6
    intercept: float = -4.9
    usual_agreement: float = 0.4
    confirmed: float = 0.5
    doubted: float = 0.3
    rejected: float = 0.25
    frames_to_lose: int = 3
    frames_to_find: int = 1

    def __post_init__(self) -> None:
        if not 0 <= self.rejected <= self.doubted <= self.confirmed <= 1:
            raise InputError(
                "StateConfig: 0 ≤ rejected ≤ doubted ≤ confirmed ≤ 1 is needed, found "
                f"{self.rejected}, {self.doubted} and {self.confirmed}."
            )
        if min(self.frames_to_lose, self.frames_to_find) < 1:
            raise InputError(
                "StateConfig: frames_to_lose and frames_to_find must be 1 or more, found "
                f"{self.frames_to_lose} and {self.frames_to_find}."
            )


@dataclass(frozen=True)
class RecoveryConfig:
    """How a lost object is looked for (mode all_axes only).

    Args:
        enabled: look for lost objects at all; without, a lost object's poses are given as they are.
        near_candidates: poses that are refined in the search near where the object was last seen,
            which comes first.
        interval: frames from one search to the next, in the whole image. One takes as long as some
            45 ordinary frames: with 10, a frame without the object costs less than five.
        max_milliseconds: time that the search for a lost object may take of each frame, instead of
            a whole search at intervals; it goes on from frame to frame, in the picture that it
            began with. None finishes a search in its frame, so that the same video always gives the
            same poses.
        half_turn_frames: after an object was found, it is compared in so many frames with itself
            turned by half (upside down, back to front), and followed on as what is more likely; 0
            never.
        half_turn_interval: frames from one comparison to the next.
        half_turn_evidence: by how much the sum of the log odds of the confidence must be larger.
        states: when an object counts as lost, and as found.
    """

    enabled: bool = True
    near_candidates: int = 16
    interval: int = 10
    max_milliseconds: float | None = None
    half_turn_frames: int = 4
    half_turn_interval: int = 5
    half_turn_evidence: float = 0.5
    states: StateConfig = field(default_factory=StateConfig)

    def __post_init__(self) -> None:
        if min(self.interval, self.near_candidates) < 1:
            raise InputError(
                "RecoveryConfig: interval and near_candidates must be 1 or more, found "
                f"{self.interval} and {self.near_candidates}."
            )
        if self.half_turn_interval < 1 or min(self.half_turn_frames, self.half_turn_evidence) < 0:
            raise InputError(
                "RecoveryConfig: half_turn_interval must be 1 or more, half_turn_frames and "
                f"half_turn_evidence 0 or more, found {self.half_turn_interval}, "
                f"{self.half_turn_frames} and {self.half_turn_evidence}."
            )
        if self.max_milliseconds is not None and not self.max_milliseconds >= 0:
            raise InputError(
                "RecoveryConfig: max_milliseconds must not be negative, found "
                f"{self.max_milliseconds}."
            )
