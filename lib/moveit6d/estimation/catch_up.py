"""From where a search found an object to where it is now, through the frames since then.

Never searches, and never decides whether the object is there.
"""

from __future__ import annotations

from collections.abc import Generator

from ..config import RecoveryConfig
from ..frame import Frame
from ..geometry.pose import Pose
from .detection import PoseDetector
from .detection.steps import Steps
from .refine import refine_starts
from .results import Start
from .track_state import TrackState


class CatchUp:
    """A search that takes several frames, and then the way from its pose to the present frame.

    Args:
        detector: whose search it is.
        steps: the search, which has the frame that it began with.
        config: how many of the frames since then are kept, and followed.
    """

    def __init__(self, detector: PoseDetector, steps: Steps, config: RecoveryConfig) -> None:
        self.detector, self.config = detector, config
        self._later: list[Frame] = []
        self.steps: Generator[None, None, Pose | None] = self._followed(steps)

    def add(self, frame: Frame) -> None:
        """A frame that came after the search began; its pixels are copied."""
        self._later.append(frame.copy())
        if len(self._later) > self.config.frames_kept:
            self._later = self._later[-1::-2][::-1]  # the newest stays

    def _followed(self, steps: Steps) -> Generator[None, None, Pose | None]:
        found = yield from steps
        if found.pose is None or not self._later:
            return found.pose
        detector, stride = self.detector, self.config.stride
        mesh, config = detector.mesh, detector.settings
        track = TrackState.begin(mesh, mesh.inner(found.pose), config)
        while self._later:
            frame = self._later[:stride][-1]
            del self._later[:stride]
            starts = [Start(frame, mesh, centred) for centred in track.starts()]
            (end,) = refine_starts(
                starts,
                policy=detector.policy,
                renderer=detector.renderer,
                loop=config.loop,
                groups=[0] * len(starts),
            )
            if end.centred is None:
                track.miss()
            else:
                track.add(end.centred, end.confidence)
            if self._later:
                yield
        return track.pose
