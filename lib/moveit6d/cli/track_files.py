"""The files of `moveit6d track` beside its table: overlay, start picture, pages, logs for rerun.

Never decides what they look like; `visualization` does.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..io import replacing
from .common import versions, weights_facts
from .earlier import PICTURE, START_PICTURE
from .messages import note
from .reporting import movie_file, reporting, rerun_log
from .resuming import numbered

if TYPE_CHECKING:
    from ..datasets.video import FrameSource
    from ..evaluation.run_tracker import AnyTracker, TrackedFrame
    from ..geometry.pose import Pose
    from .resuming import Earlier


@dataclass(frozen=True)
class TrackFiles:
    """Where the files lie; None for what is not wanted. `pages` and `logs` have one an object."""

    movie: Path | None
    picture: Path | None
    pages: Sequence[Path | None]
    logs: Sequence[Path | None]

    @staticmethod
    def of(
        args: argparse.Namespace, names: Sequence[str], first: int, frames: FrameSource
    ) -> TrackFiles:
        """By the options; what cannot be gone on with is named for a track's `first` frame."""
        drawn = None if args.no_overlay else args.output
        picture = drawn and not first and not _holds_frames(args.output, frames)
        return TrackFiles(
            movie=drawn and numbered(drawn / "overlay.mp4", first),
            picture=args.output / PICTURE if picture else None,
            pages=files_of(args.report, names),
            logs=[path and numbered(path, first) for path in files_of(args.rerun, names)],
        )

    @property
    def kept(self) -> dict[str, str]:
        """What a summary says of them."""
        return {} if self.picture is None else {START_PICTURE: PICTURE}

    @property
    def written(self) -> list[Path]:
        """All that are wanted."""
        every = (self.movie, self.picture, *self.pages, *self.logs)
        return [path for path in every if path is not None]


def files_of(path: Path | None, names: Sequence[str]) -> list[Path | None]:
    """An option's file, of several objects one for each with its name: report_cup.html."""
    if path is None or len(names) == 1:
        return [path] * len(names)
    return [path.with_stem(f"{path.stem}_{name}") for name in names]


@contextmanager
def track_files(
    files: TrackFiles,
    args: argparse.Namespace,
    names: Sequence[str],
    tracker: AnyTracker,
    starts: Sequence[Pose | None],
    frames: FrameSource,
    earlier: Sequence[Earlier],
) -> Iterator[Callable[[TrackedFrame], None]]:
    """What writes a frame to the files; they are whole when the block ends, however it ends.

    `starts` are the poses that the track begins from, `earlier` the track that is gone on with, an
    entry an object.
    """
    from .drawing import draw_step

    meshes, camera, renderer = tracker.meshes, tracker.camera, tracker.renderer
    low = tracker.config.low_confidence
    picture = StartPicture(files.picture, tracker, starts)
    with ExitStack() as stack:
        pages = [
            stack.enter_context(
                reporting(
                    path, _about(args, number), mesh, camera, frames, renderer, low, before, name
                )
            )
            for number, (path, mesh, before, name) in enumerate(
                zip(files.pages, meshes, earlier, names, strict=True)
            )
        ]
        movie = stack.enter_context(movie_file(files.movie, frames.fps))
        logs = [
            stack.enter_context(rerun_log(path, mesh, camera))
            for path, mesh in zip(files.logs, meshes, strict=True)
        ]

        def write(step: TrackedFrame) -> None:
            picture.see(step)
            if movie is not None:
                movie.write(draw_step(step, meshes, camera, renderer))
            for one, page, log in zip((step, *step.others), pages, logs, strict=True):
                if page is not None:
                    page.add(one)
                if log is not None:
                    log.write(one.frame, one.row, one.error)

        yield write


class StartPicture:
    """The first picture with a pose: the first frame with the start poses on it, if it shows them.

    Without start poses it is the first frame in which an object is found.
    """

    def __init__(
        self, path: Path | None, tracker: AnyTracker, starts: Sequence[Pose | None]
    ) -> None:
        self.path, self.tracker, self.starts = path, tracker, list(starts)

    def see(self, step: TrackedFrame) -> None:
        """Write the picture, if it is not yet there and this frame shows a pose."""
        from ..visualization.overlay import draw_pose, draw_text

        if self.path is None or step.frame.image is None:
            return
        rows = [one.row for one in (step, *step.others)]
        poses = [start or row.pose for start, row in zip(self.starts, rows, strict=True)]
        self.starts = [None] * len(poses)  # of this frame alone
        if all(pose is None for pose in poses):
            return
        image, tracker = step.frame.image, self.tracker
        for mesh, pose in zip(tracker.meshes, poses, strict=True):
            if pose is not None:
                image = draw_pose(image, mesh, pose, tracker.camera, tracker.renderer)
        _save(self.path, draw_text(image, f"frame {step.frame.index}  start"))
        self.path = None


def _save(path: Path, image: Any) -> None:
    from PIL import Image

    with replacing(path) as temporary:
        Image.fromarray(image).save(temporary, format="PNG")


def _holds_frames(folder: Path, frames: FrameSource) -> bool:
    """Whether the frames lie in a folder, where a picture would be taken for one; says so."""
    from ..datasets.video import image_files

    found = folder.resolve() in {path.parent.resolve() for path in image_files(frames)}
    if found:
        note(f"{PICTURE} is left out: in {folder} it would be a frame of the video.")
    return found


def _about(args: argparse.Namespace, number: int) -> dict[str, str]:
    """What a report says of the command."""
    return {
        "object": str(args.mesh[number]),
        "video": str(args.video),
        "start": str((args.start and args.start[number]) or "looked for"),
        **{name: str(value) for name, value in weights_facts(args.weights).items()},
        "moveit6d": versions()["moveit6d"],
    }
