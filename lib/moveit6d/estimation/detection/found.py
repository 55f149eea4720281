"""What a detector answers: the poses that it found, and those that it looked at and did not accept.

Never searches.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from ...config import VerificationConfig
from ...geometry.pose import Pose
from ..results import TrackingResult
from ..seed_detector import SeedDetection
from .verification import Evidence


@dataclass(frozen=True)
class FoundPose:
    """One instance: the refined result and what speaks for it.

    `result.pose` is in the mesh file's frame; `result.confidence` is the probability that it is
    right. The method `seeds` has no other evidence than the confidence.
    """

    result: TrackingResult
    evidence: Evidence | None = None

    @property
    def pose(self) -> Pose:
        """Object → camera, in the mesh file's frame, metres."""
        assert self.result.pose is not None  # results without a pose are never kept
        return self.result.pose

    @property
    def probability(self) -> float:
        """That the pose is right."""
        return self.result.confidence

    def known_present(self, config: VerificationConfig) -> FoundPose:
        """The same, its probability if the object is known to be in the image."""
        if self.evidence is None:
            return self
        probability = self.evidence.probability(config, present=True)
        return replace(self, result=replace(self.result, confidence=probability))


@dataclass(frozen=True)
class Detection:
    """What was found of one object in one image, the most probable first.

    `instances` are those found; `rejected` the best of what was looked at and not accepted; `seeds`
    how the method `seeds` came there.
    """

    instances: tuple[FoundPose, ...]
    rejected: tuple[FoundPose, ...] = ()
    seeds: SeedDetection | None = None

    @property
    def found(self) -> bool:
        """Whether the object is in the image, as far as can be told."""
        return bool(self.instances)

    @property
    def best(self) -> FoundPose | None:
        """The most probable pose, accepted or not; None if nothing could be looked at."""
        every = (*self.instances, *self.rejected)
        return max(every, key=lambda one: one.probability) if every else None

    @property
    def pose(self) -> Pose | None:
        """The pose of the most probable instance; None if the object was not found."""
        return self.instances[0].pose if self.instances else None

    @property
    def probability(self) -> float:
        """That the best pose is right; 0 if there is none."""
        return 0.0 if self.best is None else self.best.probability
