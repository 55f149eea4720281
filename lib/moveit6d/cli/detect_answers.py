"""What `moveit6d detect --image` found of an object in an image, as its files hold it.

Never searches and never writes.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from ..datasets.pose_files import PoseRow, track_columns
from .journal import pose_line, pose_of

if TYPE_CHECKING:
    from ..datasets.video import VideoFrame
    from ..estimation.detection import Detection
    from ..geometry.pose import Pose

POINTS_ERROR = "points_error_pixels"  # in detection.json, where the points alone say the pose


@dataclass(frozen=True)
class Answer:
    """Poses of one object, and facts for detection.json.

    With each pose its probability, the iterations of its loop and why that ended, which is empty
    for a pose that no loop led to. `best` is the probability of the best pose, found or not;
    `error` says why an image could not be used.
    """

    poses: tuple[tuple[Pose, float, int, str], ...]
    best: float = 0.0
    milliseconds: float | None = None
    facts: dict[str, Any] | None = None
    error: str | None = None

    @property
    def clicked(self) -> bool:
        """Whether the pose is that of points, and nothing in the image confirms it."""
        return POINTS_ERROR in (self.facts or {})

    @property
    def found(self) -> bool:
        """Whether the object was found in the image."""
        return bool(self.poses) and not self.clicked


@dataclass(frozen=True)
class DetectedRow(PoseRow):
    """A line of poses.csv with the number of the instance, the most probable first."""

    instance: int | None = None


def columns(objects: int, instances: int) -> tuple[str, ...]:
    """Columns of poses.csv: those of a track, before the state the instance if there are more."""
    own = track_columns(objects)
    return own if instances == 1 else (*own[:-1], "instance", own[-1])


def rows(frame: VideoFrame, name: str, answer: Answer) -> list[DetectedRow]:
    """A row for each instance of an object; one without a pose if there is none."""
    unsure = answer.error is not None or answer.clicked
    if not answer.poses:
        return [
            DetectedRow(
                frame.index, frame.name, stopped_by="failed", confidence=answer.best,
                milliseconds=answer.milliseconds, object=name,
                state="uncertain" if unsure else "lost",
            )
        ]  # fmt: skip
    state = "uncertain" if unsure else "tracking"
    return [
        DetectedRow(
            frame.index, frame.name, pose, iterations, stopped_by, probability,
            answer.milliseconds, object=name, state=state, probability=probability,
            instance=number,
        )
        for number, (pose, probability, iterations, stopped_by) in enumerate(answer.poses)
    ]  # fmt: skip


def pose_file(name: str, number: int) -> str:
    """Where the pose of an instance of an object is written, the most probable one first."""
    stem = f"pose_{name}" if name else "pose"
    return f"{stem}_{number + 1}.json" if number else f"{stem}.json"


def detection_facts(found: Detection) -> dict[str, Any]:
    """What detection.json says of an object in an image."""
    if found.seeds is not None:
        sinks = [
            {"pixel": sink.centre.tolist(), "strength": sink.strength, "size": sink.size}
            for place in found.seeds.places
            for sink in place
        ]
        return {"candidates": len(found.seeds.candidates), "sinks": sinks}
    poses = [
        {
            "probability": round(one.probability, 4),
            "accepted": number < len(found.instances),
            **{name: round(value, 4) for name, value in vars(one.evidence).items()},
        }
        for number, one in enumerate((*found.instances, *found.rejected))
    ]
    return {"poses": poses}


def answer_line(answer: Answer) -> dict[str, Any]:
    """What a journal keeps of an answer, exactly."""
    return {**vars(answer), "poses": [[pose_line(pose), *more] for pose, *more in answer.poses]}


def answer_of(line: Mapping[str, Any]) -> Answer:
    """The answer of a journal's line."""
    poses = tuple((pose_of(pose), *more) for pose, *more in line["poses"])
    return Answer(**{**line, "poses": poses})
