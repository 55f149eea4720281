"""Settings of what happens when an object is lost.

Never computes anything.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from ..errors import InputError
from .detection import check_stages


@dataclass(frozen=True)
class StateConfig:
    """When the state of a tracked object changes.

    The probability that a pose is right is a logistic regression on the network's confidence and on
    the contour's agreement with the colours of earlier frames, which the network never saw. It was
    fitted on tracks of synthetic sequences in which the object goes away and comes back, of
    training meshes that were held out (`tools/fit_probabilities.py`). Of meshes without colours,
    for which the network's confidence says less, another one of its log odds was fitted likewise.

    Args:
        confidence: weight of the network's confidence.
        agreement: weight of the contour's agreement, a share.
        intercept: intercept of the regression.
        uncoloured_confidence: of meshes without colours: weight of the confidence's log odds.
        uncoloured_agreement: of meshes without colours: weight of the contour's agreement.
        uncoloured_intercept: of meshes without colours: intercept of the regression.
        usual_agreement: the contour's agreement that is assumed where it is not measured (without
            contour refinement): the confidence alone decides then.
        confirmed: probability from which an object is tracked.
        doubted: probability below which a tracked object becomes uncertain. Between the two the
            state stays what it was.
        rejected: probability below which a frame counts as one without the object, and an object
            that was found is not followed.
        frames_to_lose: so many rejected frames in a row, and the object is lost.
        frames_to_find: so many confirmed frames in a row, and an object that was found again is
            tracked; until then it is uncertain.
    """

    confidence: float = 9.45
    agreement: float = 1.28
    intercept: float = -6.21
    uncoloured_confidence: float = 1.33
    uncoloured_agreement: float = 1.56
    uncoloured_intercept: float = -1.51
    usual_agreement: float = 0.4
    confirmed: float = 0.7
    doubted: float = 0.6
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
class SecondLookConfig:
    """When a followed object is looked for anew near where it is believed to be.

    A wrong pose that the loop does not leave is seldom sure; the search, which sees the object from
    all sides, mostly finds the right one, and the network is more confident there.

    Args:
        below: confidence below which such a search is made; 0 none of these.
        after_found: so many such searches are made of an object that was lost and found, however
            confident: what is found in a bad picture may be turned. 0 none.
        interval: frames from one such search to the next at least; half of that after the object
            was found.
        evidence: by how much the log odds of the confidence must be larger at the pose that it
            finds, once both are refined in the same frame.
        found_evidence: the same after the object was found, as no track speaks for its pose.
        places: how many places near the object are looked into.
        stages: how many candidates are refined, and by how many iterations
            (`DetectorConfig.stages`).
    """

    below: float = 0.8
    after_found: int = 3
    interval: int = 10
    evidence: float = 1.0
    found_evidence: float = 0.3
    places: int = 10
    stages: tuple[tuple[int, int], ...] = ((16, 1), (8, 2), (2, 4))

    def __post_init__(self) -> None:
        if not 0 <= self.below <= 1 or self.after_found < 0:
            raise InputError(
                "SecondLookConfig: below must be from 0 to 1 and after_found 0 or more, found "
                f"{self.below} and {self.after_found}."
            )
        if min(self.evidence, self.found_evidence) < 0:
            raise InputError(
                "SecondLookConfig: evidence and found_evidence must be 0 or more, found "
                f"{self.evidence} and {self.found_evidence}."
            )
        if min(self.interval, self.places) < 1:
            raise InputError(
                "SecondLookConfig: interval and places must be 1 or more, found "
                f"{self.interval} and {self.places}."
            )
        check_stages("SecondLookConfig", self.stages)


@dataclass(frozen=True)
class RecoveryConfig:
    """How a lost object is looked for (mode all_axes only).

    Args:
        enabled: look for lost objects at all; without, a lost object's poses are given as they are.
        near_candidates: poses that are refined in the search near where the object was last seen,
            which comes first.
        first_interval: frames from the first search of the whole image to the next; it doubles from
            search to search.
        interval: largest number of frames from one search to the next. One takes as long as some 45
            ordinary frames: with 10, a frame without the object costs less than five in the end.
        max_milliseconds: time that the search for a lost object may take of each frame, instead of
            a whole search at intervals; it goes on from frame to frame, in the picture that it
            began with, and what it finds is followed from there to the present frame. Objects share
            it. None finishes a search in its frame, so that the same video always gives the same
            poses.
        frames_kept: frames that are kept, at most, while such a search goes on; of more of them
            every second one. More of them are safer to follow, and take longer.
        stride: frames from one in which the object is then followed to the next: each may take
            longer than a new frame takes to come.
        distance: metres from the camera, the nearer first, between which lost objects are looked
            for; None: wherever they can be seen.
        half_turn_frames: after an object was found, it is compared in so many frames with itself
            turned by half (upside down, back to front), and followed on as what is more likely; 0
            never.
        half_turn_interval: frames from one comparison to the next.
        half_turn_evidence: by how much the sum of the log odds of the confidence must be larger.
        second_look: when a followed object is looked for anew.
        states: when an object counts as lost, and as found.
    """

    enabled: bool = True
    near_candidates: int = 16
    first_interval: int = 2
    interval: int = 10
    max_milliseconds: float | None = None
    frames_kept: int = 24
    stride: int = 2
    distance: tuple[float, float] | None = None
    half_turn_frames: int = 4
    half_turn_interval: int = 5
    half_turn_evidence: float = 0.5
    second_look: SecondLookConfig = field(default_factory=SecondLookConfig)
    states: StateConfig = field(default_factory=StateConfig)

    def __post_init__(self) -> None:
        if min(self.first_interval, self.interval, self.near_candidates) < 1:
            raise InputError(
                "RecoveryConfig: first_interval, interval and near_candidates must be 1 or more, "
                f"found {self.first_interval}, {self.interval} and {self.near_candidates}."
            )
        if min(self.frames_kept, self.stride) < 1:
            raise InputError(
                "RecoveryConfig: frames_kept and stride must be 1 or more, found "
                f"{self.frames_kept} and {self.stride}."
            )
        if self.distance is not None and not 0 < self.distance[0] <= self.distance[1]:
            raise InputError(
                "RecoveryConfig: distance must be two positive numbers of metres, the nearer "
                f"first, found {self.distance}."
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
