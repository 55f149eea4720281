"""A second look at a followed object of low confidence: the search, near where it should be.

Never decides that an object is lost.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..config import RecoveryConfig
from ..frame import Frame
from ..geometry.pose import Pose
from .catch_up import CatchUp
from .detection import PoseDetector, SearchRegion
from .detection.steps import within
from .refine import refine_starts
from .results import Refined, Start
from .states import log_odds


class SecondLook:
    """The searches for one object while it is followed.

    Args:
        detector: finds the object; its settings are replaced by those of second looks.
        config: when to look, and how long.
        target: the number by which the policy knows the object (`LoopState.target`).
    """

    def __init__(self, detector: PoseDetector, config: RecoveryConfig, target: int = 0) -> None:
        look, settings = config.second_look, detector.settings
        searching = replace(
            settings.detection,
            match=replace(settings.detection.match, places=look.places),
            stages=look.stages,
        )
        self.detector = PoseDetector(
            detector.mesh,
            detector.camera,
            policy=detector.policy,
            renderer=detector.renderer,
            config=replace(settings, detection=searching),
            store=detector.store,
            threads=detector.threads,
        )
        self.config, self.recovery, self.limit = look, config, config.max_milliseconds
        self.target = target
        self._search: CatchUp | None = None
        self._waiting, self._unasked = 0, 0
        self._evidence = look.evidence

    def was_found(self) -> None:
        """The object was lost and found: look again a few times, soon, however confident."""
        self._waiting, self._unasked = self.config.interval // 2, self.config.after_found
        self._search = None

    def better(self, start: Start, confidence: float, taken: Sequence[Pose] = ()) -> Refined | None:
        """Where the loop ends from another pose nearby, if that is much likelier.

        Called once a frame with the pose found there (`start`), its confidence, and where other
        instances of the mesh are (`taken`, mesh file's frame). Begins a search where the confidence
        is low, or where the object was found lately; it may end in a later frame.
        """
        found = self._found(start, confidence, taken)
        if found is None:
            return None
        detector = self.detector
        other = refine_starts(
            [replace(start, centred=found)],
            policy=detector.policy,
            renderer=detector.renderer,
            loop=detector.settings.loop,
            targets=[self.target],
        )[0]
        if other.centred is None or detector.is_taken(other.centred, taken):
            return None
        gain = log_odds(other.confidence) - log_odds(confidence)
        return other if gain > self._evidence else None

    def _found(self, start: Start, confidence: float, taken: Sequence[Pose]) -> Pose | None:
        """The centred pose found near that of a start, if a search ends in this frame."""
        self._waiting = max(0, self._waiting - 1)
        under_way, self._search = self._search, None  # a generator that raises has ended
        if under_way is not None:
            under_way.add(start.frame)
        elif self._waiting or (confidence >= self.config.below and not self._unasked):
            return None
        else:
            near = start.mesh.outer(start.centred)
            under_way = self._begin(start.frame, SearchRegion(near=near, taken=tuple(taken)))
        ended = within(under_way.steps, self.limit)
        if ended is None:
            self._search = under_way
            return None
        return None if ended.found is None else start.mesh.inner(ended.found)

    def _begin(self, frame: Frame, region: SearchRegion) -> CatchUp:
        """A search; and when to look the next time, and how much this one must bring."""
        config = self.config
        if self._unasked:
            self._unasked -= 1
            self._waiting, self._evidence = max(1, config.interval // 2), config.found_evidence
        else:
            self._waiting, self._evidence = config.interval, config.evidence
        if self.limit is not None:
            frame = frame.copy()  # the search goes on when the caller has the image again
        steps = self.detector.steps(frame, region, most=config.stages[0][0])
        return CatchUp(self.detector, steps, self.recovery)
