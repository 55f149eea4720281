"""Tracks many sequences: each with a fresh tracker, kept in files, resumed, here or elsewhere.

Never scores, and never shows a tracker a true pose but that of the first frame and those that a
protocol of resets gives it.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from ..checks import reading
from ..config import TrackerConfig
from ..datasets.pose_files import RESULT_COLUMNS, PoseRow, PoseWriter, write_poses
from ..datasets.sequences import Sequence as Video
from ..datasets.video import VideoFrame
from ..io import read_json, write_json
from ..parallel import JobResult, run_jobs
from .protocols import NO_RESET, Protocol, follow_protocol
from .run_tracker import TrackedFrame, calibrating, failures_in
from .track_scores import read_track

if TYPE_CHECKING:
    from ..estimation import PoseTracker, TrackingResult
    from ..policies import Policy
    from ..rendering.renderer import Renderer

# Of our own tracks: what every result has, and what a report of it needs.
OWN_COLUMNS = (*RESULT_COLUMNS, "iterations", "stopped_by", "confidence", "reset", "state")


@dataclass(frozen=True, kw_only=True)
class TrackJob:
    """One sequence and all that decides about its track; can be sent to another process.

    Args:
        sequence: frames, camera, mesh, start and truth.
        config: of the tracker. The first pose is exact: it calibrates if `config` says so.
        protocol: when the true pose is given.
        frames: frames after the first at most; None for all.
        threads: CPU threads while it computes.
        settings: what makes two tracks of the sequence the same, as JSON holds it.
    """

    sequence: Video
    config: TrackerConfig = field(default_factory=TrackerConfig)
    protocol: Protocol = NO_RESET
    frames: int | None = None
    threads: int | None = 1
    settings: Mapping[str, Any] = field(default_factory=dict)


Job = TypeVar("Job", bound=TrackJob)


@dataclass(frozen=True)
class Tracked:
    """What came out: rows by frame, and the text of a page if there was to be one.

    `failures` say why frames have no pose.
    """

    rows: dict[int, PoseRow]
    page: str | None = None
    failures: Mapping[int, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Finished(Generic[Job]):
    """A job with its track, or with the sentence that says why there is none.

    `kept` tells a track that was there already from one that was made now.
    """

    job: Job
    tracked: Tracked | None = None
    error: str | None = None
    kept: bool = False


@dataclass(frozen=True)
class Workers:
    """Where work is done: in so many processes, or on a Ray cluster with so many CPUs a task."""

    jobs: int = 1
    ray: str | None = None
    cpus: int = 1

    @property
    def here(self) -> bool:
        """Whether it is done in this process."""
        return self.ray is None and self.jobs == 1


class TrackStore:
    """A folder of tracks: NAME.csv, and NAME.json, which is written last and marks it as whole."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def file(self, job: TrackJob, suffix: str = ".csv") -> Path:
        """Where a job's track is."""
        return self.folder / f"{job.sequence.name}{suffix}"

    def read(self, job: TrackJob) -> Tracked | None:
        """A whole track that was made with the same settings, else None."""
        table, mark = self.file(job), self.file(job, ".json")
        if not (table.exists() and mark.exists()):
            return None
        content = read_json(mark)
        if content.get("settings") != dict(job.settings):
            return None
        with reading(mark):
            failures = failures_in(content)
        return Tracked(read_track(table, job.sequence.load_mesh), failures=failures)

    def begin(self, job: TrackJob) -> None:
        """Take an older track away: it must not be taken for a new one that ends early."""
        for suffix in (".json", ".csv"):
            self.file(job, suffix).unlink(missing_ok=True)

    def finish(self, job: TrackJob, tracked: Tracked, facts: Mapping[str, Any]) -> None:
        """Write the mark, with `facts` that are worth knowing later."""
        missing = sum(row.pose is None for row in tracked.rows.values())
        failures = [{"frame": k, "error": text} for k, text in tracked.failures.items()]
        summary = {"frames": len(tracked.rows), "failed": missing, "failures": failures}
        write_json(self.file(job, ".json"), {**summary, "settings": dict(job.settings), **facts})


def run_all(
    jobs: Sequence[Job],
    here: Callable[[Job, Path | None], Tracked],
    work: Callable[[Job], Tracked],
    *,
    store: TrackStore | None = None,
    resume: bool = False,
    workers: Workers = Workers(),
    facts: Mapping[str, Any] | None = None,
    watch: Callable[[Iterator[JobResult[Tracked]], int], Iterable[JobResult[Tracked]]]
    | None = None,
) -> Iterator[Finished[Job]]:
    """Every job with its track: first those that `store` holds already, then each as it is done.

    In this process `here(job, path)` tracks and writes rows to the path as they come, so that an
    interruption leaves them; elsewhere `work(job)`, a function of a module, does. `facts` go into
    every mark; `watch(results, number)` shows how far the work elsewhere is.
    """
    waiting = []
    for job in jobs:
        kept = store.read(job) if store is not None and resume else None
        if kept is not None:
            yield Finished(job, kept, kept=True)
            continue
        waiting.append(job)

    def one(job: Job) -> Tracked:
        if store is None:
            return here(job, None)
        store.begin(job)
        return here(job, store.file(job))

    if workers.here:
        results: Iterable[JobResult[Tracked]] = run_jobs(one, waiting)
    else:
        found = run_jobs(work, waiting, jobs=workers.jobs, ray=workers.ray, cpus=workers.cpus)
        results = found if watch is None else watch(found, len(waiting))
    for result in results:
        job = waiting[result.index]
        if store is not None and not workers.here:
            store.begin(job)  # until now the older track was whole
            if result.result is not None:
                rows = result.result.rows
                write_poses(store.file(job), [rows[frame] for frame in sorted(rows)], OWN_COLUMNS)
        if store is not None and result.result is not None:
            store.finish(job, result.result, facts or {})
        yield Finished(job, result.result, result.error)


def tracker_and_frames(
    job: TrackJob, policy: Policy, renderer: Renderer
) -> tuple[PoseTracker[TrackingResult], Iterable[VideoFrame]]:
    """A tracker at a sequence's start pose, and the frames from that of the start on.

    The start pose is exact: as the first frame is read, the tracker calibrates from it if the
    job's `config` says so.
    """
    from ..estimation import PoseTracker

    sequence = job.sequence
    tracker = PoseTracker(
        sequence.load_mesh(),
        sequence.camera,
        sequence.start,
        policy=policy,
        renderer=renderer,
        config=job.config,
        threads=job.threads,
    )
    frames: Iterable[VideoFrame] = (f for f in sequence.open() if f.index >= sequence.first)
    if job.config.calibration.enabled:
        frames = calibrating(tracker, frames)
    return tracker, frames


def track(job: TrackJob, policy: Policy, renderer: Renderer) -> Iterator[TrackedFrame]:
    """Track one sequence from its start pose: one result for each frame after the first.

    The first frame's pose is given: the tracker may calibrate from that frame, and does not
    follow it.
    """
    tracker, frames = tracker_and_frames(job, policy, renderer)
    later = (frame for frame in frames if frame.index > job.sequence.first)
    wanted = later if job.frames is None else itertools.islice(later, job.frames)
    yield from follow_protocol(tracker, wanted, job.sequence.truth, job.protocol)


def gather(
    sequence: Video, tracked: Iterable[TrackedFrame], path: Path | None
) -> dict[int, PoseRow]:
    """Rows by frame; with a path also written there as they come, in the benchmark's format.

    The first row is the given start, without a time.
    """
    rows = {sequence.first: PoseRow(frame=sequence.first, pose=sequence.start)}
    with nullcontext() if path is None else PoseWriter(path, OWN_COLUMNS) as table:
        if table is not None:
            table.write(rows[sequence.first])
        for one in tracked:
            rows[one.row.frame] = one.row
            if table is not None:
                table.write(one.row)
    return rows
