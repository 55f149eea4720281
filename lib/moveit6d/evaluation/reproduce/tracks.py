"""What the paper's tables need of a track: the frames that count, beside the truth.

Never tracks and never scores.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch

from ...datasets.pose_files import PoseRow
from ...datasets.sequences import Sequence as Video
from ...geometry.pose import Pose
from ..sequence_scores import scored_truth


@dataclass(frozen=True)
class ScoredTrack:
    """One sequence's scored frames (N) beside their true poses, mesh file's frame.

    The first frame and those whose pose was given by the protocol are left out; a frame without a
    pose keeps the last one before it; `iterations` and `milliseconds` (N,)
    are by frame, None where nobody counted, as of a frame that could not be read.
    """

    video: Video
    frames: tuple[int, ...]
    estimate: Pose
    truth: Pose
    iterations: tuple[int | None, ...]
    milliseconds: tuple[float | None, ...]


def scored(video: Video, rows: Mapping[int, PoseRow]) -> ScoredTrack | None:
    """The frames that count: known truth, a keyframe where there are such, pose not given.

    None where no frame counts.
    """
    known = scored_truth(video, rows)
    frames, estimates, iterations, times = [], [], [], []
    last = video.start
    for frame, row in sorted(rows.items()):
        last = last if row.pose is None else row.pose
        if frame == video.first or frame not in known:
            continue
        frames.append(frame)
        estimates.append(last)
        iterations.append(row.iterations)
        times.append(row.milliseconds)
    if not frames:
        return None
    truth = Pose.stack([known[frame].to(torch.float64) for frame in frames])
    found = Pose.stack([pose.to(torch.float64) for pose in estimates])
    return ScoredTrack(video, tuple(frames), found, truth, tuple(iterations), tuple(times))
