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
from .journal import CONTENT, MISSING, file_facts, journal_file, other_fact, read_journal
from .narrowing import NAMES as NARROWING
from .settings import fields_of

if TYPE_CHECKING:
    from ..config import StateConfig
    from ..datasets.pose_files import PoseRow
    from ..datasets.video import VideoFrame
    from ..evaluation.run_tracker import AnyTracker

# The arguments that a track goes by, beside the settings and the weights.
SAME = ("mesh", "mesh_unit", "video", "camera", "fov", "start", "exact_start",
        "texture_from_start", "allow_untextured", "renderer", "float32", *NARROWING)  # fmt: skip


def earlier_rows(
    output: Path,
    args: argparse.Namespace,
    facts: dict[str, Any],
    center: Any = (0.0, 0.0, 0.0),
) -> list[PoseRow]:
    """The rows of the interrupted run in a folder; none without `--resume` or before its start.

    `facts` are this run's (`track_facts`), `center` is the object's middle in the mesh file's
    frame. `InputError` if the run was begun with other files or settings, or if nothing says with
    which.
    """
    from ..datasets.pose_files import by_frame, read_poses, whole_lines

    table = output / "poses.csv"
    if not args.resume or not table.is_file():
        return []
    rows = read_poses(table, whole_lines(table), center)
    if [*by_frame(rows, str(table))] != list(range(len(rows))):
        raise InputError(f"{table}: its frames are not 0, 1, 2, …; it cannot be gone on with.")
    _check_states(rows, table)
    if rows:
        _check_facts(table, facts)
    return rows


def track_facts(args: argparse.Namespace, config: TrackerConfig) -> dict[str, Any]:
    """What a track goes by: one that was begun with others cannot be gone on with."""
    arguments = {name: plain(getattr(args, name, None)) for name in SAME}
    weights = {"weights": weights_facts(args.weights)["weights_sha256"]}
    settings = {name: value for name, _, _, value in fields_of(config)}
    every = {**arguments, **weights, **file_facts(args), **settings}
    facts: dict[str, Any] = json.loads(json.dumps(every))
    return facts


def earlier_failure(row: PoseRow) -> dict[str, Any] | None:
    """What a summary says of an earlier frame without a pose, as nearly as its row tells it."""
    from ..estimation.states import TrackingState

    if row.pose is not None:
        return None
    unread = row.milliseconds is None
    lost = "the object is lost." if row.state == TrackingState.LOST else "there is no pose."
    return {"frame": row.frame, "error": "the frame cannot be read." if unread else lost}


def numbered(path: Path, first: int) -> Path:
    """The name of a file that cannot be gone on with: from a later frame on with its number."""
    return path.with_stem(f"{path.stem}_{first:06d}") if first else path


def _check_facts(table: Path, facts: dict[str, Any]) -> None:
    """`InputError` unless a table's rows are of a track that goes by these facts."""
    before = _facts_before(table, facts)
    if not before:
        raise InputError(
            f"{table}: nothing says which arguments and settings its rows were tracked with; leave "
            "out --resume to begin anew, or give another --output."
        )
    other = other_fact(before, facts)
    if other is not None:
        raise InputError(
            f"{table.parent} holds a track with another --{other}; give the arguments and settings "
            "that it was begun with, or another --output."
        )


def _facts_before(table: Path, facts: dict[str, Any]) -> dict[str, Any]:
    """What the track of a table's rows goes by; empty if nobody knows.

    A killed track left its journal, every other one its summary. The summary of an earlier version
    lacks settings that came later: those are taken for the same.
    """
    from ..io import read_json

    journal, summary = journal_file(table), table.with_name("summary.json")
    if journal.is_file():
        before, entries = read_journal(journal)
        if entries:  # before the first one the rows are those of an older track
            return before
    if not summary.is_file():
        return {}
    content = read_json(summary)
    known = {name: _in_summary(content, name) for name in facts}
    known = {name: value for name, value in known.items() if value is not MISSING}
    later = {name: value for name, value in facts.items() if not name.endswith(CONTENT)}
    return {**later, **known} if "mesh" in known else {}


def _check_states(rows: Sequence[PoseRow], table: Path) -> None:
    from ..estimation.states import TrackingState

    known = {"", *map(str, TrackingState)}  # other programs' tables have none
    for row in rows:
        if row.state not in known:
            raise InputError(
                f"{table}, row of frame {row.frame}: state must be {', '.join(TrackingState)}, "
                f"found {row.state[:40]!r}; correct it, or give another --output."
            )


def _in_summary(content: dict[str, Any], name: str) -> Any:
    """What a summary says of an argument, of a file or of a setting; MISSING if nothing."""
    if name == "weights" or name.endswith(CONTENT):
        return content.get(f"{name.removesuffix(CONTENT)}{CONTENT}", MISSING)
    found: Any = content.get("arguments" if name in SAME else "config", MISSING)
    for part in name.split("."):
        found = found.get(part, MISSING) if isinstance(found, dict) else MISSING
    return found


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
