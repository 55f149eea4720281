"""One sequence as a task: tracked, drawn and reported wherever it is sent.

Never knows of other sequences and never scores for a table.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..datasets.pose_files import camera_content
from ..datasets.video import ImageFolder
from ..errors import InputError
from ..evaluation.protocols import PROTOCOLS
from ..evaluation.runner import (
    Finished,
    Tracked,
    TrackJob,
    TrackStore,
    Workers,
    gather,
    run_all,
    track,
)
from ..geometry.mesh_files.digest import mesh_digest
from ..geometry.symmetry_file import symmetries_beside
from .common import Setting, complaining, make_tools, tools, versions, weights_facts
from .messages import progress
from .reporting import Gathered, movie_file, rerun_log, sequence_page

if TYPE_CHECKING:
    from ..datasets.sequences import Sequence
    from ..evaluation.run_tracker import TrackedFrame
    from ..policies import Policy
    from ..rendering.renderer import Renderer


HEAD = 1 << 20  # bytes of a video, or of its first image, by which it is known


@dataclass(frozen=True, kw_only=True)
class SequenceJob(TrackJob):
    """A track with what a command makes of it; can be sent to another process.

    `movie` and `log` are files that the worker writes; `facts` are shown on its page.
    """

    setting: Setting
    count_resets: bool = False
    movie: Path | None = None
    log: Path | None = None
    page: bool = False
    facts: Mapping[str, str] = field(default_factory=dict)


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
    gathered = Gathered()
    frames = track(job, policy, renderer)
    watched = _with_bar(job, frames) if bar else frames
    gathered.rows = gather(job.sequence, _drawn(job, watched, renderer, gathered), path)
    page = page_of(job, gathered, renderer) if job.page else None
    return Tracked(gathered.rows, page, gathered.failures)


def run_sequences(
    jobs: list[SequenceJob],
    setting: Setting,
    *,
    store: TrackStore | None,
    resume: bool,
    workers: Workers,
) -> Iterator[Finished[SequenceJob]]:
    """Every job as it is done, here with a bar for each sequence, elsewhere with one for all."""
    policy, renderer = make_tools(setting)

    def here(job: SequenceJob, path: Path | None) -> Tracked:
        return track_job(job, policy, renderer, path, bar=True)

    return run_all(
        jobs,
        here,
        work,
        store=store,
        resume=resume,
        workers=workers,
        facts={"versions": versions()},
        watch=lambda results, number: progress(results, number, "track", "sequence"),
    )


def settings_of_track(
    sequence: Sequence, setting: Setting, protocol: str, **more: Any
) -> dict[str, Any]:
    """What makes two tracks of a sequence the same, as JSON holds it."""
    return {
        **weights_facts(setting.weights),
        "renderer": setting.renderer,
        "config": json.loads(json.dumps(setting.config.as_dict())),
        "compute": setting.compute,
        "protocol": protocol,
        "first": sequence.first,
        "start": [round(n, 9) for n in sequence.start.matrix.flatten().tolist()],
        "mesh": mesh_digest(sequence.mesh) if sequence.mesh.is_file() else None,
        "mesh_unit": sequence.mesh_unit,
        "symmetries": _symmetries(sequence),
        "camera": camera_content(sequence.camera),
        "images": _images_digest(sequence),
        "truth": _given_truth(sequence, protocol),
        **more,
    }


def page_of(job: SequenceJob, gathered: Gathered, renderer: Renderer) -> str:
    """The page of a finished track."""
    from ..evaluation.sequence_scores import score_track, scored_truth

    score = score_track(job.sequence, gathered.rows, job.count_resets)
    truth = scored_truth(job.sequence, gathered.rows, job.count_resets)
    low = job.config.low_confidence
    return sequence_page(job.sequence, gathered, truth, score, job.facts, renderer, low)


def _with_bar(job: SequenceJob, steps: Iterator[TrackedFrame]) -> Iterator[TrackedFrame]:
    length = job.sequence.open().length
    count = job.frames if length is None else min(length - 1, job.frames or length)
    return progress(steps, count, job.sequence.name)


def _drawn(
    job: SequenceJob, steps: Iterator[TrackedFrame], renderer: Renderer, gathered: Gathered
) -> Iterator[TrackedFrame]:
    """The same steps; failures are said on stderr, and all goes into a video and a log if asked."""
    from .drawing import draw_step

    sequence = job.sequence
    mesh = sequence.load_mesh()
    rate = None if job.movie is None else sequence.open().fps
    with (
        movie_file(job.movie, rate) as movie,
        rerun_log(job.log, mesh, sequence.camera, sequence.truth) as log,
    ):
        for step in complaining(steps, f"{sequence.name}, "):
            gathered.add(step)
            if movie is not None:
                movie.write(draw_step(step, mesh, sequence.camera, renderer))
            if log is not None:
                log.write(step.frame, step.row, step.error)
            yield step


def _symmetries(sequence: Sequence) -> list[Any] | None:
    """As the mesh has them; None where they cannot be read, which the track says."""
    with suppress(InputError):
        found = sequence.symmetries
        found = symmetries_beside(sequence.mesh) if found is None else found
        axes = [[one.axis.tolist(), one.offset.tolist()] for one in found.continuous]
        return [found.discrete.tolist(), axes]
    return None


def _images_digest(sequence: Sequence) -> str:
    """Of the frames' names and sizes and of how the first one begins: none is decoded."""
    files = (sequence.frames,) if sequence.images is None else sequence.images
    digest = hashlib.sha256()
    with suppress(InputError, OSError):  # of missing files; the track says so
        if sequence.images is None and sequence.frames.is_dir():
            files = ImageFolder(sequence.frames).paths
        for file in files:
            size = file.stat().st_size if file.is_file() else None
            digest.update(os.fsencode(f"{file.name} {size}\n"))
        if files and files[0].is_file():
            with files[0].open("rb") as first:
                digest.update(first.read(HEAD))
    return digest.hexdigest()


def _given_truth(sequence: Sequence, protocol: str) -> str | None:
    """Of the true poses, None where no reset gives them to the tracker."""
    rule = PROTOCOLS[protocol]
    if rule.reset_every is None and rule.reset_on is None:
        return None
    digest = hashlib.sha256()
    for frame, pose in sorted(sequence.truth.items()):
        numbers = (*pose.rotation.flatten().tolist(), *pose.translation.tolist())
        digest.update(json.dumps([frame, *(round(n, 9) for n in numbers)]).encode())
    return digest.hexdigest()
