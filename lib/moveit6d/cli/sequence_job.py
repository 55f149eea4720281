"""One sequence as a task: tracked, drawn and reported wherever it is sent.

Never knows of other sequences and never scores for a table.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from .common import Setting, complaining, tools
from .messages import progress
from .reporting import Gathered, rerun_log, sequence_page

if TYPE_CHECKING:
    from ..datasets.pose_files import PoseRow
    from ..datasets.sequences import Sequence
    from ..evaluation.protocols import Protocol
    from ..evaluation.run_tracker import TrackedFrame
    from ..policies import Policy
    from ..rendering.renderer import Renderer


@dataclass(frozen=True)
class SequenceJob:
    """One sequence and all that decides about its track; can be sent to another process.

    `movie` and `log` are files that the worker writes; `facts` are shown on its page.
    """

    sequence: Sequence
    setting: Setting
    protocol: Protocol
    count_resets: bool = False
    movie: Path | None = None
    log: Path | None = None
    page: bool = False
    facts: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Tracked:
    """What came out: rows by frame, and the text of the page if there was to be one."""

    rows: dict[int, PoseRow]
    page: str | None = None


def work(job: SequenceJob) -> Tracked:
    """Do the job in a worker process, which keeps its network for the next one."""
    return track_job(job, *tools(job.setting))


def track_job(
    job: SequenceJob,
    policy: Policy,
    renderer: Renderer,
    path: Path | None = None,
    bar: bool = False,
) -> Tracked:
    """Do the job with this policy and renderer.

    With a path the rows are also written there as they come, so that Ctrl-C leaves them; `bar`
    shows how far it is.
    """
    from ..estimation import PoseTracker, TrackingResult
    from ..evaluation.benchmark import gather, run_sequence

    def make_tracker(mesh: Any, camera: Any, start: Any) -> PoseTracker[TrackingResult]:
        return PoseTracker(
            mesh,
            camera,
            start,
            policy=policy,
            renderer=renderer,
            config=job.setting.config,
            threads=job.setting.threads,
        )

    gathered = Gathered()
    steps = run_sequence(
        job.sequence, make_tracker, job.protocol, job.setting.config.calibration.enabled
    )
    watched = _with_bar(job.sequence, steps) if bar else steps
    gathered.rows = gather(job.sequence, _drawn(job, watched, renderer, gathered), path)
    return Tracked(gathered.rows, page_of(job, gathered, renderer) if job.page else None)


def page_of(job: SequenceJob, gathered: Gathered, renderer: Renderer) -> str:
    """The page of a finished track."""
    from ..evaluation.benchmark import score_track, scored_truth

    score = score_track(job.sequence, gathered.rows, job.count_resets)
    truth = scored_truth(job.sequence, gathered.rows, job.count_resets)
    return sequence_page(job.sequence, gathered, truth, score, job.facts, renderer)


def _with_bar(sequence: Sequence, steps: Iterator[TrackedFrame]) -> Iterator[TrackedFrame]:
    length = sequence.open().length
    return progress(steps, None if length is None else length - 1, sequence.name)


def _drawn(
    job: SequenceJob, steps: Iterator[TrackedFrame], renderer: Renderer, gathered: Gathered
) -> Iterator[TrackedFrame]:
    """The same steps; failures are said on stderr, and all goes into a video and a log if asked."""
    from ..visualization.video import VideoWriter
    from .drawing import draw_step

    sequence = job.sequence
    mesh = sequence.load_mesh()
    movie_file = nullcontext() if job.movie is None else VideoWriter(job.movie)
    with movie_file as movie, rerun_log(job.log, mesh, sequence.camera, sequence.truth) as log:
        for step in complaining(steps, f"{sequence.name}, "):
            gathered.add(step)
            if movie is not None:
                movie.write(draw_step(step, mesh, sequence.camera, renderer))
            if log is not None:
                log.write(step.frame, step.row, step.error)
            yield step
