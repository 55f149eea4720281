"""`moveit6d track`: follow objects through one video.

Never more than reading, the tracker's update for each frame, and writing.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Sequence
from contextlib import AbstractContextManager, nullcontext
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .apart import check_apart, check_truth, given_paths
from .camera_options import CAMERA_FILES, add_camera_options, camera_of
from .common import (
    UNITS,
    Setting,
    add_tracking_options,
    add_untextured_option,
    add_verb,
    complaining,
    make_tools,
    new_folder,
    versions,
    weights_facts,
)
from .earlier import clear_earlier
from .journal import Journal, journal_file
from .messages import note, progress
from .narrowing import add_narrowing_options, check_first, first_pose, is_narrowed, known_of
from .objects import load_meshes, object_names, painted, peek, read_starts, wants_paint
from .reporting import check_report, check_rerun, reporting, rerun_log
from .resuming import earlier_rows, going_on, numbered, track_facts
from .settings import EVERYTHING, SettingsPart
from .track_summary import track_records, track_summary, verdict

if TYPE_CHECKING:
    from ..datasets.pose_files import PoseWriter
    from ..datasets.video import FrameSource, VideoFrame
    from ..evaluation.run_tracker import TrackedFrame, TrackSummary
    from ..geometry.camera import Camera
    from ..geometry.mesh import Mesh
    from ..geometry.pose import Pose

# The settings that decide about a video: those for single images are not read, and the errors of
# width and displacement decide about numbers that are not written.
READ = SettingsPart(
    EVERYTHING.names,
    but=(
        "loop.augment",
        "loop.width_error",
        "loop.displacement_error",
        "multi_start.below",
        "multi_start.around_start",
        "multi_start.around_result",
        "multi_start.rounds",
        "single_image",
    ),
)

DESCRIPTION = (
    """\
Finds the pose in every frame, each starting from the one before; the first frame starts from
--start, or from where the object is found, in the whole image or where --box, --mask, --points
and --distance say. A frame that cannot be used (damaged, of another size) is recorded and the
track goes on with the next one; only the first that can be read must be of the camera's size. A
start must be roughly right: within about a quarter of the object's width and 20 degrees. A lost
object is looked for, near where it was and then in the whole image, and followed again once it
is found.

Several objects: --mesh, --mesh_unit and --start once for each of them (one --mesh_unit does for
all); the same mesh twice are two instances.

files read:
  --mesh    OBJ, PLY, GLB, Collada (.dae), STL or OFF, with texture, vertex colours or plain
  --video   a folder of images (taken in the order of their names), a video file, the
            address of a stream (rtsp://…, http://…) or the index of a camera (then stop with
            Ctrl-C; frames that come while another is worked on are left out)
"""
    + CAMERA_FILES
    + """\
  --start   {"rotation": 3x3, "translation": [x, y, z]}: object to camera, x right, y down,
            z forward, metres, in the frame of the mesh file; or as a 4x4 matrix: a JSON list of
            rows, or four lines of numbers

files written to --output:
  poses.csv     (rows can be read while the track runs)
                frame,image,r11,...,r33,tx,ty,tz,steps,stopped_by,confidence,milliseconds,state;
                one row a frame (of several objects one row each, with a column object before
                state), empty numbers where there is no pose; the state is tracking, uncertain
                (there is a pose, it may be wrong) or lost
  overlay.mp4   outline and axes drawn on the frames (red where the confidence is low)
  summary.json  frames, failed frames, milliseconds, states and events (from which frame to which
                each state lasted), versions
  --report      one HTML page of the run for any browser: curves, pictures, worst frames first
  --rerun       the run for the rerun viewer (needs: pip install 'moveit6d[rerun]')

--resume goes on with a track that was interrupted or killed, given the arguments and settings that
it was begun with (poses.csv.unfinished holds them until summary.json is written). The report shows
the whole track; a video and a file for rerun hold the new frames and have the number of the first
one in their names: overlay_000123.mp4.

exit code 3 also says that no object was found in any frame.
"""
)

EPILOG = """\
examples:
  moveit6d track --mesh drill.glb --mesh_unit m --video clip.mp4 \\
      --camera camera.json --start pose.json --output out --report out/report.html
  moveit6d track --mesh part.stl --mesh_unit mm --video frames/ \\
      --camera camera.json --start pose.json --output out --no_overlay --threads 1
  moveit6d track --mesh cup.glb --mesh can.glb --mesh_unit m --video clip.mp4 \\
      --camera camera.json --output out
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "track", "follow objects through a video", DESCRIPTION, EPILOG)
    _add_needed_options(parser)
    parser.add_argument(
        "--start",
        type=Path,
        action="append",
        metavar="FILE",
        help="pose in the first frame, once for each mesh (default: look for the objects)",
    )
    parser.add_argument(
        "--exact_start",
        action="store_true",
        help="the start pose is exact: calibrate from the first frame",
    )
    parser.add_argument(
        "--texture_from_start",
        action="store_true",
        help="paint meshes without colours from the first frame, at the start pose",
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on behind the last row of --output's poses.csv"
    )
    parser.add_argument("--no_overlay", action="store_true", help="leave out overlay.mp4")
    parser.add_argument("--report", type=Path, metavar="FILE", help="write an HTML page of the run")
    parser.add_argument("--rerun", type=Path, metavar="FILE", help="write an .rrd for rerun")
    add_narrowing_options(parser, " of the first frame, instead of --start")
    add_tracking_options(parser, part=READ)
    parser.set_defaults(run=run)


def _add_needed_options(parser: argparse.ArgumentParser) -> None:
    """What every track needs."""
    needed = parser.add_argument_group("needed")
    needed.add_argument(
        "--mesh",
        type=Path,
        required=True,
        action="append",
        metavar="FILE",
        help="the object; once for each of several",
    )
    needed.add_argument(
        "--mesh_unit",
        choices=UNITS,
        required=True,
        action="append",
        help="the mesh's unit; once, or for each mesh",
    )
    add_untextured_option(parser)
    needed.add_argument(
        "--video",
        required=True,
        metavar="SOURCE",
        help="folder of images or a pattern ('DIR/*-color.png'), video file, address (rtsp://…, "
        "http://…) or camera index",
    )
    add_camera_options(needed)
    needed.add_argument(
        "--output", type=Path, required=True, metavar="DIR", help="folder for the results"
    )


def run(args: argparse.Namespace) -> int:
    """Track and write."""
    from ..datasets.live import Latest
    from ..datasets.pose_files import PoseWriter, track_columns
    from ..datasets.video import Prefetched, is_live, open_frames
    from ..estimation import PoseDetector, PoseTracker, TemplateStore
    from ..estimation.detection import default_store
    from ..evaluation.run_tracker import calibrating, run_tracker
    from .drawing import draw_step

    check_first(args)
    meshes = _meshes(args)
    starts, frames = _starts(args, meshes), open_frames(args.video)
    camera = camera_of(args, frames)
    _check_files(args, frames)
    setting = Setting.of(args)
    policy, renderer = make_tools(setting)
    # What is live and read ahead would show the past.
    ahead = _sized(iter(Latest(frames) if is_live(frames) else Prefetched(frames)), camera)
    tools: dict[str, Any] = {
        "policy": policy, "renderer": renderer, "config": setting.config,
        "store": TemplateStore(default_store()), "threads": setting.threads,
    }  # fmt: skip
    if is_narrowed(args):
        first, ahead = peek(ahead)
        detector = PoseDetector(meshes[0], camera, **tools)
        starts = [first_pose(detector, first, known_of(args, args.mesh_unit[0]))]
    if wants_paint(args, meshes, setting.config.keyframes.enabled):
        first, ahead = peek(ahead)
        meshes = painted(meshes, starts, first, camera, setting.config.texture)
    tracker = PoseTracker(meshes, camera, starts, **tools)
    names = object_names(args.mesh)
    output = new_folder(args.output)
    facts = track_facts(args, setting.config)
    earlier = earlier_rows(output, args, facts, meshes[0].center)
    records = track_records(len(meshes), earlier)
    movie_file, log_file = _numbered_files(output, args, len(earlier))
    with (
        Journal(output / "poses.csv", facts, resume=bool(earlier)) as journal,
        track_summary(records, names, args, setting, journal),
        reporting(args.report, _about(args), meshes[0], camera, frames, renderer, earlier) as page,
        PoseWriter(output / "poses.csv", track_columns(len(meshes)), resume=bool(earlier)) as table,
        _movie(movie_file, frames.fps) as movie,
        rerun_log(log_file, meshes[0], camera) as log,
    ):
        watched = progress(ahead, frames.length, "track")
        exact = args.exact_start and setting.config.calibration.enabled
        known = calibrating(tracker, _first_seen(watched)) if exact else watched
        todo = going_on(tracker, known, earlier) if earlier else known
        steps = complaining(run_tracker(tracker, todo, names))
        if not earlier:
            steps = _replacing(steps, output, [movie_file, args.report, log_file])
        for step in _kept(steps, records, table, journal):
            if page is not None:
                page.add(step)
            if movie is not None:
                movie.write(draw_step(step, meshes, camera, renderer))
            if log is not None:
                log.write(step.frame, step.row, step.error)
    return verdict(args, records, names)


def _meshes(args: argparse.Namespace) -> list[Mesh]:
    """The objects; `InputError` where there are several and an option is for one."""
    if len(args.mesh) > 1 and (args.report or args.rerun or args.resume):
        raise InputError(
            "--report, --rerun and --resume are for one object; leave them out with several."
        )
    return load_meshes(args)


def _starts(args: argparse.Namespace, meshes: Sequence[Mesh]) -> list[Pose | None]:
    """The poses of --start; one in millimetres is said with its file."""
    from ..geometry.pose import in_metres

    starts = read_starts(args, len(meshes))
    for path, pose, mesh in zip(args.start or (), starts, meshes, strict=False):
        if pose is not None:
            in_metres(pose, str(path), mesh.center)
    return starts


def _check_files(args: argparse.Namespace, frames: FrameSource) -> None:
    """`InputError` where a file cannot be written, or would destroy another one."""
    from ..datasets.video import image_files

    output, table = args.output, args.output / "poses.csv"
    images = image_files(frames) or [path for path in [Path(args.video)] if path.is_file()]
    written = {
        "--output": (
            table, journal_file(table), output / "summary.json", output / "overlay.mp4",
            *output.glob("overlay_*.mp4"),
        ),
        "--report": (args.report,),
        "--rerun": (args.rerun,),
    }  # fmt: skip
    given_files = given_paths(args, "output", "report", "rerun")
    check_apart(written, [*given_files, *images])
    check_truth(output, images)
    check_report(args.report, frames)
    check_rerun(args.rerun)


def _sized(frames: Iterator[VideoFrame], camera: Camera) -> Iterator[VideoFrame]:
    """All frames; `InputError` at once if the first that can be read is not of the camera's size.

    A later one of another size is a bad frame like others.
    """
    from ..frame import check_size

    seen = []
    for frame in frames:
        seen.append(frame)
        if frame.image is not None:
            height, width = frame.image.shape[:2]
            check_size(frame.name, width, height, camera)
            break
    return chain(seen, frames)


def _about(args: argparse.Namespace) -> dict[str, str]:
    """What a report says of the command."""
    return {
        "object": ", ".join(map(str, args.mesh)),
        "video": str(args.video),
        "start": ", ".join(map(str, args.start or ["looked for"])),
        **{name: str(value) for name, value in weights_facts(args.weights).items()},
        "moveit6d": versions()["moveit6d"],
    }


def _first_seen(frames: Iterable[VideoFrame]) -> Iterator[VideoFrame]:
    """The same frames; a note where the first, which is to be calibrated from, cannot be read."""
    for number, frame in enumerate(frames):
        if number == 0 and frame.image is None:
            note("--exact_start: the first frame cannot be read, so that nothing is calibrated.")
        yield frame


def _replacing(
    steps: Iterable[TrackedFrame], output: Path, written: Sequence[Path | None]
) -> Iterator[TrackedFrame]:
    """The same steps; at the first an earlier track's files are removed, no sooner."""
    for number, step in enumerate(steps):
        if number == 0:
            clear_earlier(output, written)
        yield step


def _kept(
    steps: Iterable[TrackedFrame],
    records: Sequence[TrackSummary],
    table: PoseWriter,
    journal: Journal,
) -> Iterator[TrackedFrame]:
    """The same steps, each of them written to the table and noted for the summary."""
    for number, step in enumerate(steps):
        for record, one in zip(records, (step, *step.others), strict=True):
            table.write(one.row)
            record.add(one)
        if number == 0:  # until now the table may have held an older track's rows
            journal.add({"first": step.frame.index})
        yield step


def _numbered_files(
    output: Path, args: argparse.Namespace, first: int
) -> tuple[Path | None, Path | None]:
    """The overlay and the file for rerun, if wanted, named for a track's first frame."""
    movie = None if args.no_overlay else numbered(output / "overlay.mp4", first)
    return movie, None if args.rerun is None else numbered(args.rerun, first)


def _movie(path: Path | None, fps: float | None) -> AbstractContextManager[Any]:
    from ..visualization.video import VideoWriter

    return nullcontext() if path is None else VideoWriter(path, fps or 25.0)
