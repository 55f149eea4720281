"""Going on with a track that was interrupted: its rows, its frames, and the tracker's state.

Never tracks.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..config import TrackerConfig
from ..errors import InputError
from .common import plain, weights_facts
from .narrowing import NAMES as NARROWING
from .settings import fields_of

if TYPE_CHECKING:
    from ..config import StateConfig
    from ..datasets.pose_files import PoseRow
    from ..datasets.video import VideoFrame
    from ..evaluation.run_tracker import AnyTracker

# What a run goes by: a track that was begun with others cannot be gone on with.
SAME = ("mesh", "mesh_unit", "video", "camera", "fov", "start", "exact_start",
        "texture_from_start", "allow_untextured", "renderer", "float32", *NARROWING)  # fmt: skip
MISSING = object()


def earlier_rows(
    output: Path,
    args: argparse.Namespace,
    config: TrackerConfig,
    center: Any = (0.0, 0.0, 0.0),
) -> list[PoseRow]:
    """The rows of the interrupted run in a folder; none without `--resume` or before its start.

    `center` is the object's middle in the mesh file's frame. `InputError` if its summary.json says
    that it was begun with other files or settings.
    """
    from ..datasets.pose_files import by_frame, read_poses, whole_lines
    from ..io import read_json

    table = output / "poses.csv"
    if not args.resume or not table.is_file():
        return []
    rows = read_poses(table, whole_lines(table), center)
    if [*by_frame(rows, str(table))] != list(range(len(rows))):
        raise InputError(f"{table}: its frames are not 0, 1, 2, …; it cannot be gone on with.")
    _check_states(rows, table)
    summary = output / "summary.json"
    if summary.is_file():
        content = read_json(summary)
        argument = _other_argument(content, args)
        if argument is not None:
            raise InputError(
                f"{output} holds a track with another --{argument}; give the arguments that it was "
                "begun with, or another --output."
            )
        setting = _other_setting(content.get("config") or {}, config)
        if setting is not None:
            raise InputError(
                f"{output} holds a track with another --{setting}; give the settings that it was "
                "begun with, or another --output."
            )
    return rows


def _check_states(rows: Sequence[PoseRow], table: Path) -> None:
    from ..estimation.states import TrackingState

    known = {"", *map(str, TrackingState)}  # other programs' tables have none
    for row in rows:
        if row.state not in known:
            raise InputError(
                f"{table}, row of frame {row.frame}: state must be {', '.join(TrackingState)}, "
                f"found {row.state[:40]!r}; correct it, or give another --output."
            )


def _other_argument(summary: dict[str, Any], args: argparse.Namespace) -> str | None:
    """The first argument that is not what an earlier summary says; None if all are the same."""
    before = summary.get("arguments") or {}
    for name in SAME:
        if name in before and before[name] != plain(getattr(args, name, None)):
            return name
    # By what is in it: another file may have come to the same place.
    digest = weights_facts(args.weights)["weights_sha256"]
    return "weights" if summary.get("weights_sha256", digest) != digest else None


def _other_setting(before: dict[str, Any], config: TrackerConfig) -> str | None:
    """The first setting that is not what an earlier summary says; None if all are the same."""
    for name, _, _, value in fields_of(config):
        found: Any = before
        for part in name.split("."):
            found = found.get(part, MISSING) if isinstance(found, dict) else MISSING
        if found is not MISSING and found != json.loads(json.dumps(value)):
            return name
    return None


def going_on(
    tracker: AnyTracker, frames: Iterable[VideoFrame], rows: Sequence[PoseRow]
) -> Iterator[VideoFrame]:
    """The frames after those of the rows; before the first, the tracker is told what they say."""
    for frame in frames:
        if frame.index < len(rows):
            continue
        if frame.index == len(rows):
            for row in rows:
                tell(tracker, row)
        yield frame


def tell(tracker: AnyTracker, row: PoseRow) -> None:
    """Let a tracker of one object know what became of an earlier frame."""
    import torch

    (track,), (supervisor,) = tracker.tracks, tracker.supervisors
    if row.pose is None and row.milliseconds is None:
        return  # a frame that could not be read tells a tracker nothing
    if row.pose is None:
        track.miss()
        supervisor.missed()
    else:
        track.add(track.mesh.inner(row.pose.to(torch.float64)), row.confidence or 0.0)
        supervisor.machine.update(_probability(supervisor.config.states, row))
    if row.state:
        supervisor.tell(row.state)


def _probability(config: StateConfig, row: PoseRow) -> float:
    """That a row's pose is right, as nearly as can be told without the contour's agreement."""
    from ..estimation.states import TrackingState, probability_of

    if row.state == TrackingState.TRACKING:
        return 1.0
    return probability_of(config, row.confidence or 0.0, config.usual_agreement)
