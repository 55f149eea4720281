"""Looking for a lost object while the video goes on: near first, then in the whole image.

Never decides that an object is lost and never remembers more than the search that is under way.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from ..config import RecoveryConfig
from ..errors import InputError
from ..frame import Frame
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from .catch_up import CatchUp
from .detection import PoseDetector, SearchRegion
from .detection.region import check_distance
from .detection.steps import within
from .half_turns import HalfTurnCheck
from .results import StopReason, TrackingResult
from .second_look import SecondLook
from .states import StateMachine, TrackingState, probability_of

LOST = "The object is lost."


class Supervisor:
    """One object's state, and the search for it while it is lost.

    Args:
        detector: finds the object; None: a lost object is not looked for.
        config: when, and how long.
        found: whether the object's pose is known at the beginning.
        look: finds a followed object that is in doubt; None: it is not looked for.
        coloured: whether the object's mesh has colours (`Mesh.has_colours`).
    """

    def __init__(
        self,
        detector: PoseDetector | None,
        config: RecoveryConfig,
        found: bool,
        look: SecondLook | None = None,
        coloured: bool = True,
    ) -> None:
        self.detector, self.config, self.look = detector, config, look
        self.coloured = coloured
        begin = TrackingState.TRACKING if found else TrackingState.LOST
        self.machine = StateMachine(config.states, begin)
        self._search: CatchUp | None = None
        self._first_interval = min(config.first_interval, config.interval)
        self._waiting, self._interval = 0, self._first_interval
        self._near = found
        self.check: HalfTurnCheck | None = None  # of a pose that a search found

    @staticmethod
    def begin(
        detector: PoseDetector | None,
        config: RecoveryConfig,
        mesh: Mesh,
        known: bool,
        number: int = 0,
    ) -> Supervisor:
        """What watches the object with this number, whose pose is `known` or is to be looked for.

        `InputError` if it cannot be looked for, or not in the distances of the settings.
        """
        look = None
        if detector is not None:
            if config.distance is not None:
                # Of the images that are searched. Near its last pose it may be there alone.
                check_distance(config.distance, mesh, detector.camera.full_pinhole)
            if config.max_milliseconds is not None:
                detector.prepare()  # a second or two, which no frame has then
            look = SecondLook(detector, config, number)
        elif not known:
            raise InputError(
                "There is no start pose, and this policy or configuration cannot look for the "
                "object; give a start pose."
            )
        return Supervisor(detector, config, known, look, mesh.has_colours)

    @property
    def lost(self) -> bool:
        """Whether the object is looked for instead of followed."""
        return self.detector is not None and self.machine.state is TrackingState.LOST

    def tell(self, state: str) -> None:
        """Go on from the state of an earlier frame, which `TrackingState` knows by this name."""
        self.machine.state = TrackingState(state)
        self._near = self._near or self.machine.state is TrackingState.TRACKING

    def was_found(self) -> None:
        """The object's pose comes from a search: compare it with its half turns, and look again.

        Not where recovery is switched off.
        """
        if not self.config.enabled:
            return
        self.check = HalfTurnCheck(self.config)
        if self.look is not None:
            self.look.was_found()

    def forget_half_turns(self) -> None:
        """The object is followed from another pose: the comparison with half turns begins anew."""
        if self.check is not None:
            self.check.restart()

    def probability(self, confidence: float, agreement: float) -> float:
        """`probability_of` a pose of this object."""
        return probability_of(self.config.states, confidence, agreement, self.coloured)

    def assessed(self, result: TrackingResult, agreement: float) -> TrackingResult:
        """The result of following with its probability and state.

        Without its pose if the object is lost now.
        """
        probability = None
        if result.pose is not None:
            probability = self.probability(result.confidence, agreement)
        result = replace(result, state_probability=probability)
        state = self.machine.update(probability or 0.0)
        if state is TrackingState.TRACKING:
            self._near, self._interval = True, self._first_interval
        if self.lost:
            return _without_pose(result, result.error or LOST)
        return replace(result, state=state)

    def missed(self, error: str = LOST) -> TrackingResult:
        """The result for a frame in which the object was not found."""
        return _failed(error, self.machine.update(0.0))

    def unread(self, error: str) -> TrackingResult:
        """The result for a frame that cannot be used: it says nothing of the object."""
        lost = self.machine.state is TrackingState.LOST
        return _failed(error, TrackingState.LOST if lost else TrackingState.UNCERTAIN)

    @property
    def searching(self) -> bool:
        """Whether a search is under way that goes on in the next frame."""
        return self._search is not None

    def search(
        self, frame: Frame, last: Pose | None, taken: Sequence[Pose] = (), spent: float = 0.0
    ) -> Pose | None:
        """Go on looking; a pose (mesh file's frame) to follow the object from, once it is found.

        `last` is where the object was seen last, `taken` where other instances of its mesh are,
        which are followed; `spent` are milliseconds that searches of other objects have taken of
        this frame. The pose is that of the frame or of the one before.
        """
        assert self.detector is not None
        if self._search is None and self._waiting > 0:
            self._waiting -= 1
            return None
        if self._search is not None:
            self._search.add(frame)
        limit = self.config.max_milliseconds
        if limit is not None and spent > 0:
            limit -= spent
            if limit <= 0:
                return None  # the other objects' turn; this one has its own in another frame
        under_way, self._search = self._search, None  # a generator that raises has ended
        if under_way is None:
            under_way = self._begin(self.detector, frame, last if self._near else None, taken)
        ended = within(under_way.steps, limit)
        if ended is None:
            self._search = under_way
            return None
        pose = self._finished(ended.found)
        # Another search may have found that instance in the meantime.
        if pose is None or not taken:
            return pose
        return None if self.detector.is_taken(self.detector.mesh.inner(pose), taken) else pose

    def _begin(
        self, detector: PoseDetector, frame: Frame, near: Pose | None, taken: Sequence[Pose]
    ) -> CatchUp:
        """A new search: near a pose, or in the whole image."""
        if self.config.max_milliseconds is not None:
            frame = frame.copy()  # the search goes on when the caller has the image again
        known = SearchRegion(distance=self.config.distance, near=near, taken=tuple(taken))
        region = None if known.empty else known
        if near is None:
            steps = detector.steps(frame, region, most=detector.config.stages[0][0])
        else:
            steps = detector.steps(frame, region, (near,), most=self.config.near_candidates)
        return CatchUp(detector, steps, self.config)

    def _finished(self, pose: Pose | None) -> Pose | None:
        # A time limit bounds what searches cost by itself.
        self._waiting = self._interval - 1 if self.config.max_milliseconds is None else 0
        self._interval = min(2 * self._interval, self.config.interval)
        self._near = False
        self.check = HalfTurnCheck(self.config)  # says that a search has ended
        if pose is not None and self.look is not None:
            self.look.was_found()
        return pose


def _failed(error: str, state: TrackingState) -> TrackingResult:
    return TrackingResult(None, 0, StopReason.FAILED, 0.0, 0.0, error, state=state)


def _without_pose(result: TrackingResult, error: str) -> TrackingResult:
    return replace(
        result,
        pose=None,
        covariance=None,
        stopped_by=StopReason.FAILED,
        error=error,
        state=TrackingState.LOST,
    )
