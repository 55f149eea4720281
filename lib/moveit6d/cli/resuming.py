"""Going on with a track that was interrupted: its rows, its frames, and the tracker's state.

Never tracks.
"""

from __future__ import annotations

import argparse
import csv
import io
import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..checks import reading
from ..config import TrackerConfig
from ..errors import InputError
from .common import plain, weights_facts
from .journal import (
    CONTENT,
    MISSING,
    file_facts,
    journal_file,
    other_fact,
    pose_line,
    pose_of,
    read_journal,
)
from .narrowing import NAMES as NARROWING
from .settings import fields_of

if TYPE_CHECKING:
    from ..datasets.pose_files import PoseRow
    from ..datasets.video import FrameSource, VideoFrame
    from ..estimation.recovery import Supervisor
    from ..evaluation.run_tracker import AnyTracker
    from ..geometry.pose import Pose

# In journals and summaries: the pose that a search in the first frame gave; of several objects a
# list.
FOUND = "found_start"
# The arguments that a track goes by, beside the settings and the weights.
SAME = ("mesh", "mesh_unit", "video", "camera", "fov", "start", "exact_start",
        "texture_from_start", "allow_untextured", "renderer", "float32", *NARROWING)  # fmt: skip


@dataclass(frozen=True)
class Earlier:
    """An interrupted track of one object that is gone on with, or nothing.

    `rows` are its rows and `failures` say why those without a pose have none, by frame. `found` is
    the pose that a search in the first frame ended with, None if it found nothing; without such a
    search it is empty.
    """

    rows: Sequence[PoseRow] = ()
    failures: Mapping[int, str] = field(default_factory=dict)
    found: tuple[Pose | None, ...] = ()


def earlier_tracks(
    args: argparse.Namespace, facts: dict[str, Any], names: Sequence[str], centers: Sequence[Any]
) -> list[Earlier]:
    """The interrupted track in --output, an entry an object; nothing where it has no rows.

    `names` and `centers` are the objects' names and middles in the mesh files' frames.
    """
    rows = earlier_rows(args.output, args, facts, centers, names)
    if not rows:
        return [Earlier() for _ in names]
    parts = _parts(args.output)
    found = [part[FOUND] for part in parts if FOUND in part][-1:]
    if found and len(names) > 1:
        found = found[0]
    tracks = []
    for number, name in enumerate(names):
        own = rows[number :: len(names)]
        with reading(_last_record(args.output)):
            said = _failures(parts, name)
            start = tuple(pose and pose_of(pose) for pose in found[number : number + 1])
        failures = {
            row.frame: said.get(row.frame) or _failure(row) for row in own if row.pose is None
        }
        tracks.append(Earlier(own, failures, start))
    return tracks


def check_resume(args: argparse.Namespace, frames: FrameSource) -> None:
    """`InputError` where --resume is given and the frames of the track so far do not come again."""
    from ..datasets.video import is_live

    if args.resume and is_live(frames):
        raise InputError(
            f"--resume: {args.video} is live, and the frames of the track so far do not come "
            "again; leave out --resume and give another --output, and --start where the object is "
            "now, if that is known."
        )


def earlier_rows(
    output: Path,
    args: argparse.Namespace,
    facts: dict[str, Any],
    centers: Sequence[Any] = ((0.0, 0.0, 0.0),),
    names: Sequence[str] = ("",),
) -> list[PoseRow]:
    """The rows of whole frames of the interrupted run in a folder, in the order of `names`.

    None without `--resume` or before its start. `facts` are this run's (`track_facts`), `centers`
    the objects' middles in the mesh files' frames. `InputError` if the run was begun with other
    files or settings, or if nothing says with which.
    """
    from ..datasets.pose_files import read_poses, whole_lines

    table = output / "poses.csv"
    if not args.resume or not table.is_file():
        return []
    middles = dict(zip(names, centers, strict=True))
    rows = read_poses(table, whole_lines(table), lambda name: middles.get(name, centers[0]))
    order = [(number // len(names), names[number % len(names)]) for number in range(len(rows))]
    if [(row.frame, row.object) for row in rows] != order:
        raise InputError(f"{table}: its frames are not 0, 1, 2, …; it cannot be gone on with.")
    _check_states(rows, table)
    if rows:
        _check_facts(table, facts)
    return rows[: len(rows) - len(rows) % len(names)]


def cut_to_frames(table: Path, frames: int, objects: int) -> None:
    """Cut a table after so many frames: the last may not hold the rows of all objects."""
    from ..datasets.pose_files import whole_lines
    from ..io import replacing

    text = whole_lines(table)
    reader = csv.reader(io.StringIO(text, newline=""))
    for _ in range(1 + frames * objects):
        next(reader)
    kept = "".join([*io.StringIO(text, newline="")][: reader.line_num])
    if kept != text:
        with replacing(table) as temporary:
            temporary.write_text(kept, encoding="utf-8", newline="")


def track_facts(args: argparse.Namespace, config: TrackerConfig) -> dict[str, Any]:
    """What a track goes by: one that was begun with others cannot be gone on with."""
    arguments = {name: plain(getattr(args, name, None)) for name in SAME}
    weights = {"weights": weights_facts(args.weights)["weights_sha256"]}
    settings = {name: value for name, _, _, value in fields_of(config)}
    every = {**arguments, **weights, **file_facts(args), **settings}
    facts: dict[str, Any] = json.loads(json.dumps(every))
    return facts


def _last_record(output: Path) -> Path:
    """What the last run wrote of itself."""
    journal = journal_file(output / "poses.csv")
    return journal if journal.is_file() else output / "summary.json"


def _parts(output: Path) -> list[dict[str, Any]]:
    """What a track's summary and journal say, the later last."""
    from ..io import read_json

    summary, journal = output / "summary.json", journal_file(output / "poses.csv")
    # Both are there where a track that was gone on with was killed.
    parts = [read_json(summary)] if summary.is_file() else []
    return parts + (read_journal(journal)[1] if journal.is_file() else [])


def _failures(parts: Iterable[Mapping[str, Any]], name: str) -> dict[int, str]:
    """What they say of an object's failures, by frame."""
    from ..evaluation.run_tracker import failures_in

    failures: dict[int, str] = {}
    for part in parts:
        failures |= failures_in(part.get("objects", {}).get(name, {}) if name else part)
    return failures


def found_line(found: Sequence[Pose | None]) -> dict[str, Any]:
    """What a journal and a summary keep of a search in the first frame."""
    if not found:
        return {}
    lines = [None if pose is None else pose_line(pose) for pose in found]
    return {FOUND: lines if len(lines) > 1 else lines[0]}


def _failure(row: PoseRow) -> str:
    """Why an earlier frame has no pose, as nearly as its row tells it."""
    from ..estimation.states import TrackingState

    if row.milliseconds is None:
        return "the frame cannot be used."
    return "the object is lost." if row.state == TrackingState.LOST else "there is no pose."


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
    tracker: AnyTracker,
    frames: Iterable[VideoFrame],
    tracks: Sequence[Sequence[PoseRow]],
    see: Callable[[AnyTracker, VideoFrame, Sequence[PoseRow]], None],
) -> Iterator[VideoFrame]:
    """The frames after those of the tracks' rows, an entry an object.

    The tracker is told what became of those before, and `see` is shown them, as in the loop.
    """
    count = len(tracks[0])
    for frame in frames:
        if frame.index >= count:
            yield frame
            continue
        rows = [track[frame.index] for track in tracks]
        for number, row in enumerate(rows):
            tell(tracker, row, number)
        see(tracker, frame, rows)


def tell(tracker: AnyTracker, row: PoseRow, number: int = 0) -> None:
    """Let a tracker know what became of one of its objects in an earlier frame."""
    import torch

    track, supervisor = tracker.tracks[number], tracker.supervisors[number]
    if row.pose is None and row.milliseconds is None:
        return  # a frame that could not be used tells a tracker nothing
    was_lost = supervisor.lost
    if row.pose is None:
        track.miss()
        supervisor.missed()
    else:
        track.add(track.mesh.inner(row.pose.to(torch.float64)), row.confidence or 0.0)
        supervisor.machine.update(_probability(supervisor, row))
    if row.state:
        supervisor.tell(row.state)
    if was_lost and not supervisor.lost:
        supervisor.was_found()


def _probability(supervisor: Supervisor, row: PoseRow) -> float:
    """That a row's pose is right: as it says itself, or as nearly as can be told without that."""
    from ..estimation.states import TrackingState

    if row.probability is not None:
        return row.probability
    if row.state == TrackingState.TRACKING:
        return 1.0
    usual = supervisor.config.states.usual_agreement
    return supervisor.probability(row.confidence or 0.0, usual)
