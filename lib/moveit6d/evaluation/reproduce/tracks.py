"""Tracks of many sequences under the paper's protocol, kept in files so that nothing is run twice.

Never scores. A folder of tracks belongs to one setting (weights, mode, protocol, limits); with any
other one it is refused, so that figures of two settings never mix.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from ...datasets.pose_files import PoseRow, by_frame, read_poses, write_poses
from ...datasets.sequences import Sequence as Video
from ...datasets.video import VideoFrame
from ...errors import InputError
from ...geometry.pose import Pose
from ...io import read_json, write_json
from ..benchmark import MakeTracker
from ..protocols import PROTOCOL_COLUMNS, Protocol, follow_protocol, is_given
from ..run_tracker import TrackedFrame

SETTINGS = "settings.json"
COLUMNS = (*PROTOCOL_COLUMNS, "steps", "confidence")
Watch = Callable[[Video, Iterator[TrackedFrame]], Iterator[TrackedFrame]]


@dataclass(frozen=True)
class ScoredTrack:
    """One sequence's scored frames (N) beside their true poses, mesh file's frame.

    Frames whose pose was given by the protocol are left out; a frame without a pose keeps the last
    one before it (`held` counts those); `iterations` and `milliseconds` (N,) are by frame.
    """

    video: Video
    frames: tuple[int, ...]
    estimate: Pose
    truth: Pose
    held: int
    iterations: tuple[int, ...]
    milliseconds: tuple[float, ...]


@dataclass(frozen=True)
class TrackSettings:
    """How tracks are made: a tracker, a protocol by sequence, frames at most, and where they go.

    `facts` tell one setting from another; `folder` is None for tracks that are not kept.
    """

    make_tracker: MakeTracker
    protocol_of: Callable[[Video], Protocol]
    facts: Mapping[str, Any]
    folder: Path | None = None
    frames: int | None = None


def run_tracks(
    videos: Sequence[Video], settings: TrackSettings, watch: Watch
) -> Iterator[ScoredTrack]:
    """The track of every sequence, from its file where it is there already.

    `watch` sees the steps as they come (progress, complaints). Sequences without a frame to score
    are left out.
    """
    _claim(settings)
    for video in videos:
        path = None if settings.folder is None else settings.folder / f"{video.name}.csv"
        if path is not None and path.is_file():
            rows = by_frame(read_poses(path), str(path))
        else:
            rows = {step.row.frame: step.row for step in watch(video, run_one(video, settings))}
            if path is not None:
                write_poses(path, rows.values(), COLUMNS)
        track = scored(video, rows)
        if track is not None:
            yield track


def run_one(video: Video, settings: TrackSettings) -> Iterator[TrackedFrame]:
    """Track one sequence: one step for each frame after the first, whose pose is given."""
    tracker = settings.make_tracker(video.load_mesh(), video.camera, video.start)
    protocol = settings.protocol_of(video)
    yield from follow_protocol(tracker, _after(video, settings.frames), video.truth, protocol)


def scored(video: Video, rows: Mapping[int, PoseRow]) -> ScoredTrack | None:
    """The frames that count: known truth, a keyframe where there are such, pose not given."""
    frames, estimates, iterations, times = [], [], [], []
    last, held = video.start, 0
    for frame, row in sorted(rows.items()):
        last = last if row.pose is None else row.pose
        wanted = video.keyframes is None or frame in video.keyframes
        if frame not in video.truth or not wanted or is_given(row):
            continue
        held += row.pose is None
        frames.append(frame)
        estimates.append(last)
        iterations.append(row.iterations or 0)
        times.append(row.milliseconds or 0.0)
    if not frames:
        return None
    truth = Pose.stack([video.truth[frame].to(torch.float64) for frame in frames])
    found = Pose.stack([pose.to(torch.float64) for pose in estimates])
    return ScoredTrack(video, tuple(frames), found, truth, held, tuple(iterations), tuple(times))


def _claim(settings: TrackSettings) -> None:
    """Make the folder this setting's own; `InputError` if it is another's."""
    if settings.folder is None:
        return
    path = settings.folder / SETTINGS
    facts = {**settings.facts, "frames": settings.frames}
    if path.is_file():
        if read_json(path) != facts:
            raise InputError(
                f"{settings.folder} holds tracks of another setting ({SETTINGS} differs); remove "
                "it or give another --output."
            )
        return
    write_json(path, facts)


def _after(video: Video, count: int | None) -> Iterator[VideoFrame]:
    later = (frame for frame in video.open() if frame.index > video.first)
    return later if count is None else itertools.islice(later, count)
