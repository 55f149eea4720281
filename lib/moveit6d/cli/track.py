"""`moveit6d track`: follow objects through one video.

Never more than reading, the tracker's update for each frame, and writing.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

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
)
from .earlier import PICTURE, clear_earlier
from .exact_start import from_exact_start
from .journal import Journal, journal_file
from .messages import progress
from .narrowing import add_narrowing_options, check_first, searching_within, start_file
from .no_effect import note_without_effect
from .not_found import say_why
from .objects import load_meshes, note_without_colours, object_names, read_starts
from .painting import Painting
from .reporting import check_report, check_rerun
from .resuming import (
    check_resume,
    cut_to_frames,
    earlier_tracks,
    found_line,
    going_on,
    track_facts,
)
from .settings import EVERYTHING, SettingsPart
from .starting import Beginning, begin
from .track_files import TrackFiles, files_of, track_files
from .track_summary import track_record, track_summary, verdict

if TYPE_CHECKING:
    from ..datasets.pose_files import PoseWriter
    from ..datasets.video import FrameSource, VideoFrame
    from ..evaluation.run_tracker import AnyTracker, TrackedFrame, TrackSummary
    from ..geometry.camera import Camera
    from ..geometry.mesh import Mesh
    from ..geometry.pose import Pose
    from .resuming import Earlier

# The settings that decide about a video: those for single images are not read, and the errors of
# width and displacement decide about numbers that are not written.
READ = SettingsPart(
    EVERYTHING.names,
    but=(
        "loop.augment",
        "loop.augment_size",
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
all; --start none for one that is looked for); the same mesh twice are two instances. --distance
is for all that are looked for; each has a report and a file for rerun of its own, with its name:
report_cup.html.

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
                frame,image,r11,...,r33,tx,ty,tz,iterations,stopped_by,confidence,
                probability,milliseconds,state;
                one row a frame (of several objects one row each, with a column object before
                state), empty numbers where there is no pose; the state is tracking, uncertain
                (it may be wrong, or the frame was of no use: then without milliseconds) or lost
  overlay.mp4   outline and axes drawn on the frames (red where the confidence is low)
  start.png     the start pose, given or found, drawn on the first frame
  summary.json  frames, failed frames, milliseconds, states and events (from which frame to which
                each state lasted), versions
  --report      one HTML page of the run for any browser: curves, pictures, worst frames first
  --rerun       the run for the rerun viewer (needs: pip install 'moveit6d[rerun]')

--resume goes on with a track that was interrupted or killed, given the arguments and settings that
it was begun with (poses.csv.unfinished holds them until summary.json is written); not with one of
a live source, whose frames do not come again. The report shows
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
        type=start_file,
        action="append",
        metavar="FILE",
        help="pose in the first frame, once for each mesh; none for an object to look for "
        "(default: look for all)",
    )
    parser.add_argument(
        "--exact_start",
        action="store_true",
        help="the start pose is exact: calibrate from the first frame",
    )
    parser.add_argument(
        "--texture_from_start",
        action="store_true",
        help="paint meshes without colours from the first frame, at the start pose or where they "
        "are found; otherwise from the first frame in which they are tracked",
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on behind the last row of --output's poses.csv"
    )
    parser.add_argument("--no_overlay", action="store_true", help="leave out the pictures")
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
    from ..datasets.live import LatestFrames
    from ..datasets.pose_files import PoseWriter, track_columns
    from ..datasets.video import Prefetched, is_live, open_frames
    from ..evaluation.run_tracker import run_tracker

    if not any(args.start or ()):
        args.start = None
    check_first(args)
    meshes, names = load_meshes(args), object_names(args.mesh)
    starts, frames = _starts(args, meshes), open_frames(args.video)
    check_resume(args, frames)
    camera = camera_of(args, frames)
    _check_files(args, frames, names)
    setting = searching_within(Setting.of(args), args.distance)
    facts = track_facts(args, setting.config)
    earlier = earlier_tracks(args, facts, names, [mesh.center for mesh in meshes])
    # What is live and read ahead would show the past.
    ahead = _sized(iter(LatestFrames(frames) if is_live(frames) else Prefetched(frames)), camera)
    painting = Painting(meshes, names, camera, setting.config.texture, args.texture_from_start)
    tracker, beginning, ahead = _begun(args, setting, painting, starts, ahead, earlier)
    output, before = new_folder(args.output), [one.rows for one in earlier]
    records, found = [track_record(one) for one in earlier], found_line(beginning.found)
    files = TrackFiles.of(args, names, len(before[0]), frames)
    kept = {**found, **painting.kept, **files.kept}
    resume = bool(before[0])
    if resume:
        cut_to_frames(output / "poses.csv", len(before[0]), len(names))
    with (
        Journal(output / "poses.csv", facts, resume=resume) as journal,
        track_summary(records, names, args, setting, journal, kept),
        PoseWriter(output / "poses.csv", track_columns(len(meshes)), resume=resume) as table,
        track_files(files, args, names, tracker, beginning.starts, frames, earlier) as write,
    ):
        todo = progress(ahead, frames.length, "track")
        if args.exact_start and setting.config.calibration.enabled:
            todo = from_exact_start(tracker, names, todo)
        if resume:
            todo = going_on(tracker, todo, before, painting.see)
        steps = complaining(run_tracker(tracker, todo, names))
        if not resume:
            steps = _replacing(steps, output, files.written)
        for step in _kept(steps, records, table, journal, found):
            painting.see(tracker, step.frame, [one.row for one in (step, *step.others)])
            write(step)
    painting.end()
    say_why(tracker, records, names, beginning.starts)
    return verdict(args, records, names)


def _begun(
    args: argparse.Namespace,
    setting: Setting,
    painting: Painting,
    given: Sequence[Pose | None],
    frames: Iterator[VideoFrame],
    earlier: Sequence[Earlier],
) -> tuple[AnyTracker, Beginning, Iterator[VideoFrame]]:
    """The tracker at the poses to begin from, those, and all frames; what is of no use is said."""
    from ..estimation import PoseDetector, PoseTracker, TemplateStore
    from ..estimation.detection import default_store

    policy, renderer = make_tools(setting)
    meshes, camera, config = painting.meshes, painting.camera, setting.config
    note_without_effect(args, meshes, config, policy)
    note_without_colours(args, meshes, config.keyframes.enabled)
    tools: dict[str, Any] = {
        "policy": policy, "renderer": renderer, "config": config,
        "store": TemplateStore(default_store()), "threads": setting.threads,
    }  # fmt: skip
    before = tuple(pose for one in earlier for pose in one.found)
    detector = partial(PoseDetector, camera=camera, **tools)
    beginning, frames = begin(args, meshes, given, frames, detector, before)
    found = [
        start is None and pose is not None
        for start, pose in zip(given, beginning.starts, strict=True)
    ]
    # Which objects are instances of one mesh is decided before each is painted by its own view.
    tracker = PoseTracker(meshes, camera, beginning.starts, found=found, **tools)
    painting.begin(tracker, beginning)
    return tracker, beginning, frames


def _starts(args: argparse.Namespace, meshes: Sequence[Mesh]) -> list[Pose | None]:
    """The poses of --start; one in millimetres is said with its file."""
    from ..geometry.pose import in_metres

    starts = read_starts(args, len(meshes))
    for path, pose, mesh in zip(args.start or (), starts, meshes, strict=False):
        if pose is not None:
            in_metres(pose, str(path), mesh.center)
    return starts


def _check_files(args: argparse.Namespace, frames: FrameSource, names: Sequence[str]) -> None:
    """`InputError` where a file cannot be written, or would destroy another one."""
    from ..datasets.video import image_files

    output, table = args.output, args.output / "poses.csv"
    images = image_files(frames) or [path for path in [Path(args.video)] if path.is_file()]
    pages, logs = files_of(args.report, names), files_of(args.rerun, names)
    written = {
        "--output": (
            table, journal_file(table), output / "summary.json", output / "overlay.mp4",
            output / PICTURE, *output.glob("overlay_*.mp4"),
        ),
        "--report": pages,
        "--rerun": logs,
    }  # fmt: skip
    given_files = given_paths(args, "output", "report", "rerun")
    check_apart(written, [*given_files, *images])
    check_truth(output, images)
    for page, log in zip(pages, logs, strict=True):
        check_report(page, frames)
        check_rerun(log)


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


def _replacing(
    steps: Iterable[TrackedFrame], output: Path, written: Sequence[Path]
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
    found: Mapping[str, Any],
) -> Iterator[TrackedFrame]:
    """The same steps, each of them written to the table and noted for the summary.

    The journal has what a track could be gone on with: what was `found` in the first frame, and the
    failures, of several objects under their names.
    """
    for number, step in enumerate(steps):
        failures = [len(record.failures) for record in records]
        objects = (step, *step.others)
        for record, one in zip(records, objects, strict=True):
            table.write(one.row)
            record.add(one)
        if number == 0:  # until now the table may have held an older track's rows
            journal.add({"first": step.frame.index, **found})
        for record, one, before in zip(records, objects, failures, strict=True):
            if len(record.failures) > before:
                new, name = {"failures": record.failures[-1:]}, one.row.object
                journal.add({"objects": {name: new}} if name else new)
        yield step
