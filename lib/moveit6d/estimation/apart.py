"""Tracks of several instances of one mesh: no two of them come to stand on one instance.

Never moves a pose. The loop of a hidden instance ends at its neighbour, which looks the same.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..config import TrackerConfig
from ..geometry.camera import Camera
from ..geometry.pose import Pose
from .detection.instances import is_same_instance
from .results import Refined, StopReason
from .track_state import TrackState

TAKEN = "Another instance of the object is followed where this one seemed to be."


class Instances:
    """Which tracks are of one mesh, and where each of them was in the frame before.

    Args:
        tracks: of all objects.
        same: of each object the numbers of the others of its mesh.
        camera: the camera.
        config: how near poses of one instance are, and which confidence is low.
    """

    def __init__(
        self,
        tracks: Sequence[TrackState],
        same: Sequence[Sequence[int]],
        camera: Camera,
        config: TrackerConfig,
    ) -> None:
        self.tracks, self.same, self.camera, self.config = tracks, same, camera, config
        self.share = config.detection.same_instance

    def stands_on_another(self, number: int, centred: Pose, others: Mapping[int, Pose]) -> bool:
        """Whether a pose of an object is where another one is, and the object was not so far.

        `others` are centred poses of objects, by number; those of other meshes do not count.
        """
        track = self.tracks[number]
        near = [
            is_same_instance(track.mesh, self.camera, centred, others[other], self.share)
            and not is_same_instance(
                track.mesh, self.camera, track.centred, others[other], self.share
            )
            for other in self.same[number]
            if other in others
        ]
        return any(near)

    def sure(self, results: Mapping[int, Refined]) -> dict[int, Pose]:
        """The centred poses, by number, of those results whose confidence is not low."""
        return {
            number: one.centred
            for number, one in results.items()
            if one.centred is not None and one.confidence >= self.config.low_confidence
        }

    def kept_apart(
        self, results: Mapping[int, Refined], earlier: Mapping[int, Refined] | None = None
    ) -> dict[int, Refined]:
        """The results, by number; where several came to one instance all but the best fail.

        An object that was there before goes first, or else the more confident one. A result that
        took the place of an `earlier` one gives it back instead.
        """
        found, kept = dict(results), set[int]()
        several = [number for number in results if self.same[number]]
        for number in sorted(several, key=lambda one: self._rank(one, results[one])):
            result = results[number]
            if result.centred is None:
                continue
            rivals = [(one, results[one].centred) for one in self.same[number] if one in kept]
            if any(self._collide(number, result.centred, *rival) for rival in rivals):
                first = result if earlier is None else earlier[number]
                found[number] = _failed(result) if first is result else first
            else:
                kept.add(number)
        return found

    def _rank(self, number: int, result: Refined) -> tuple[bool, bool, bool, float, int]:
        """The lower the more an object has a right to where its result is."""
        track, low = self.tracks[number], result.confidence < self.config.low_confidence
        came = result.centred is not None and all(
            _distance(start, result.centred) > self.share / 2 * track.mesh.sphere_diameter
            for start in track.starts()
        )
        return low, came, not track.above_low, -result.confidence, number

    def _collide(self, number: int, centred: Pose, other: int, there: Pose | None) -> bool:
        """Whether objects are at one place now, and came there in this frame or cannot both be.

        Objects that lie on each other, or come slowly together, are left alone.
        """
        assert there is not None
        track, diameter = self.tracks[number], self.tracks[number].mesh.sphere_diameter
        before = _distance(track.centred, self.tracks[other].centred) / diameter
        now = _distance(centred, there) / diameter
        approached = now < self.share and before - now > self.share / 2
        return now < self.config.detection.least_distance or approached


def _distance(one: Pose, other: Pose) -> float:
    """Metres between the centres of two centred poses."""
    return float((one.translation - other.translation).norm())


def _failed(result: Refined) -> Refined:
    return replace(
        result,
        centred=None,
        stopped_by=StopReason.FAILED,
        confidence=0.0,
        error=TAKEN,
        localizability=0.0,
        contour_agreement=None,
        information=None,
    )
