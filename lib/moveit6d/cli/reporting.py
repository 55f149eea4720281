"""What verbs that track share about reports: pages of a run, and logs for the rerun viewer.

Never decides what a page looks like; `visualization` does.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..extras import require

if TYPE_CHECKING:
    from ..datasets.pose_files import PoseRow
    from ..datasets.sequences import Sequence
    from ..datasets.video import FrameSource
    from ..evaluation.run_tracker import TrackedFrame
    from ..evaluation.track_scores import Score
    from ..geometry.camera import Camera
    from ..geometry.mesh import Mesh
    from ..geometry.pose import Pose
    from ..rendering.renderer import Renderer
    from .resuming import Earlier


@dataclass
class Gathered:
    """Rows by frame, and why frames failed, as a report needs them."""

    rows: dict[int, PoseRow] = field(default_factory=dict)
    failures: dict[int, str] = field(default_factory=dict)

    def add(self, step: TrackedFrame) -> None:
        """Take note of one more frame."""
        self.rows[step.row.frame] = step.row
        if step.error is not None:
            self.failures[step.row.frame] = step.error


def check_report(path: Path | None, frames: FrameSource) -> None:
    """Refuse a report that cannot be written, or of a camera, whose frames cannot be seen again."""
    from ..datasets.video import is_live
    from ..io import check_writable

    if path is not None:
        require("report", "--report")
        check_writable(path)
    if path is not None and is_live(frames):
        raise InputError(
            "--report reads the video a second time, which a camera does not allow; record it "
            "first, or use --rerun."
        )


def check_rerun(path: Path | None) -> None:
    """Refuse a log for the rerun viewer that cannot be written."""
    from ..io import check_writable

    if path is not None:
        require("rerun", "--rerun")
        check_writable(path)


@contextmanager
def reporting(
    path: Path | None,
    facts: Mapping[str, str],
    mesh: Mesh,
    camera: Camera,
    frames: FrameSource,
    renderer: Renderer,
    low_confidence: float,
    earlier: Earlier | None = None,
    name: str = "",
) -> Iterator[Gathered | None]:
    """Gather steps and write the page when the block ends, however it ends, if there was a frame.

    Below `low_confidence` the track takes a pose to be wrong. `earlier` is the track that is gone
    on with, which the page shows, too; `name` is the object's where there are several. None, and
    nothing is kept, without a path.
    """
    if path is None:
        yield None
        return
    gathered = Gathered()
    if earlier is not None:
        gathered = Gathered({row.frame: row for row in earlier.rows}, dict(earlier.failures))
    try:
        yield gathered
    finally:
        if gathered.rows:
            from ..visualization.report import Run, write_report

            missing = sum(row.pose is None for row in gathered.rows.values())
            run = Run(
                title=name or mesh.name,
                verdict=f"{len(gathered.rows)} frames, {missing} without a pose",
                mesh=mesh,
                camera=camera,
                frames=frames,
                rows=gathered.rows,
                facts=facts,
                failures=gathered.failures,
                low_confidence=low_confidence,
            )
            write_report(path, run, renderer)


def movie_file(path: Path | None, fps: float | None) -> AbstractContextManager[Any]:
    """The video at a path in the making; None, and nothing is written, without one."""
    from ..visualization.video import VideoWriter

    return nullcontext() if path is None else VideoWriter(path, fps)


def rerun_log(
    path: Path | None, mesh: Mesh, camera: Camera, truth: Mapping[int, Pose] | None = None
) -> AbstractContextManager[Any]:
    """A log for the rerun viewer; None in its place without a path."""
    if path is None:
        return nullcontext()
    from ..visualization.rerun_log import RerunLog

    return RerunLog(path, mesh, camera, truth)


def sequence_page(
    sequence: Sequence,
    gathered: Gathered,
    truth: Mapping[int, Pose],
    score: Score | None,
    facts: Mapping[str, str],
    renderer: Renderer,
    low_confidence: float,
) -> str:
    """The page of one sequence; errors are against `truth`, the first of which is not counted.

    Below `low_confidence` the track takes a pose to be wrong.
    """
    from ..evaluation.track_scores import EvaluationPoints, frame_errors
    from ..visualization.report import Run, report_page

    mesh = sequence.load_mesh()
    surface = EvaluationPoints.of(mesh, symmetric=sequence.symmetric)
    errors = frame_errors(gathered.rows, truth, surface)
    run = Run(
        title=sequence.name,
        verdict="too few true poses to score" if score is None else verdict(score),
        mesh=mesh,
        camera=sequence.camera,
        frames=sequence.open(),
        rows=gathered.rows,
        facts=facts,
        truth=sequence.truth,
        errors={error.frame: error for error in errors},
        failures=gathered.failures,
        low_confidence=low_confidence,
    )
    return report_page(run, renderer)


def verdict(score: Score) -> str:
    """A track's figures in one line."""
    held = "never lost" if score.never_lost else f"lost at frame {score.lost_at}"
    resets = f", {score.resets} resets" if score.resets else ""
    return (
        f"ADD < 10 % d in {100 * score.below_10:.1f} % of {score.frames} frames, "
        f"mean {1000 * score.mean_add:.1f} mm, {held}{resets}"
    )
