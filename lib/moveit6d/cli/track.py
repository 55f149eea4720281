"""`moveit6d track`: follow one object through one video.

Never more than reading, the tracker's update for each frame, and writing.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .camera_options import CAMERA_FILES, add_camera_options, camera_of
from .common import (
    Setting,
    add_tracking_options,
    add_verb,
    complaining,
    given,
    make_tools,
    new_folder,
    versions,
    weights_facts,
)
from .messages import progress
from .reporting import check_report, reporting, rerun_log

if TYPE_CHECKING:
    from ..evaluation.run_tracker import TrackSummary

DESCRIPTION = (
    """\
Finds the pose in every frame, each starting from the one before; the first frame starts from
--start. A frame that cannot be used (damaged, of another size) is recorded and the track
goes on with the next one. The start must be roughly right: within about a quarter of the
object's width and 20 degrees.

files read:
  --mesh    OBJ, PLY, GLB or STL, with texture, vertex colours or plain
  --video   a folder of images (taken in the order of their names), a video file, the
            address of a stream (rtsp://…, http://…) or the index of a camera (then stop with
            Ctrl-C; frames that come while another is worked on are left out)
"""
    + CAMERA_FILES
    + """\
  --start   {"rotation": 3x3, "translation": [x, y, z]}: object to camera, x right, y down,
            z forward, metres, in the frame of the mesh file

files written to --output:
  poses.csv     frame,image,r11,...,r33,tx,ty,tz,steps,stopped_by,confidence,milliseconds;
                one row a frame, empty numbers where there is no pose
  overlay.mp4   outline and axes drawn on the frames (red where the confidence is low)
  summary.json  frames, failed frames, milliseconds, where the track may be lost, versions
  --report      one HTML page of the run for any browser: curves, pictures, worst frames first
  --rerun       the run for the rerun viewer (needs: pip install 'moveit6d[rerun]')
"""
)

EPILOG = """\
examples:
  moveit6d track --mesh drill.glb --mesh_unit m --video clip.mp4 \\
      --camera camera.json --start pose.json --output out --report out/report.html
  moveit6d track --mesh part.stl --mesh_unit mm --video frames/ \\
      --camera camera.json --start pose.json --output out --no_overlay --threads 1
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "track", "follow an object through a video", DESCRIPTION, EPILOG)
    needed = parser.add_argument_group("needed")
    needed.add_argument("--mesh", type=Path, required=True, metavar="FILE", help="the object")
    needed.add_argument("--mesh_unit", choices=("m", "mm"), required=True, help="the mesh's unit")
    needed.add_argument(
        "--video",
        required=True,
        metavar="SOURCE",
        help="folder of images, video file, address (rtsp://…, http://…) or camera index",
    )
    add_camera_options(needed)
    needed.add_argument(
        "--start", type=Path, required=True, metavar="FILE", help="pose in the first frame"
    )
    needed.add_argument(
        "--output", type=Path, required=True, metavar="DIR", help="folder for the results"
    )
    parser.add_argument(
        "--exact_start",
        action="store_true",
        help="the start pose is exact: calibrate from the first frame",
    )
    parser.add_argument("--no_overlay", action="store_true", help="leave out overlay.mp4")
    parser.add_argument("--report", type=Path, metavar="FILE", help="write an HTML page of the run")
    parser.add_argument("--rerun", type=Path, metavar="FILE", help="write an .rrd for rerun")
    add_tracking_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Track and write."""
    from ..datasets.live import Latest
    from ..datasets.pose_files import PoseWriter
    from ..datasets.video import Prefetched, open_frames
    from ..estimation import PoseTracker
    from ..evaluation.run_tracker import TrackSummary, calibrating, run_tracker
    from ..geometry.mesh import Mesh
    from ..geometry.pose import Pose
    from .drawing import draw_step

    mesh = Mesh.load(args.mesh, args.mesh_unit)
    start, frames = Pose.load(args.start), open_frames(args.video)
    camera = camera_of(args, frames)
    check_report(args.report, frames)
    setting = Setting.of(args)
    policy, renderer = make_tools(setting)
    tracker = PoseTracker(
        mesh,
        camera,
        start,
        policy=policy,
        renderer=renderer,
        config=setting.config,
        threads=setting.threads,
    )
    output = new_folder(args.output)
    record = TrackSummary()
    with (
        _summary(output / "summary.json", record, args, setting),
        reporting(args.report, _about(args), mesh, camera, frames, renderer) as page,
        PoseWriter(output / "poses.csv") as table,
        _movie(output / "overlay.mp4", frames.fps, args.no_overlay) as movie,
        rerun_log(args.rerun, mesh, camera) as log,
    ):
        # What is live and read ahead would show the past.
        ahead = Latest(frames) if getattr(frames, "live", False) else Prefetched(frames)
        watched = progress(ahead, frames.length, "track")
        exact = args.exact_start and setting.config.calibration.enabled
        known = calibrating(tracker, watched) if exact else watched
        for step in complaining(run_tracker(tracker, known)):
            table.write(step.row)
            record.add(step)
            page.add(step)
            if movie is not None:
                movie.write(draw_step(step, mesh, camera, renderer))
            if log is not None:
                log.write(step.frame, step.row, step.error)
    return _verdict(record, output)


def _about(args: argparse.Namespace) -> dict[str, str]:
    """What a report says of the command."""
    return {
        "object": str(args.mesh),
        "video": str(args.video),
        "start": str(args.start),
        **{name: str(value) for name, value in weights_facts(args.weights).items()},
        "moveit6d": versions()["moveit6d"],
    }


@contextmanager
def _summary(
    path: Path, record: TrackSummary, args: argparse.Namespace, setting: Setting
) -> Iterator[None]:
    """Write the summary when the block ends, however it ends, if there was a frame."""
    from ..io import write_json

    interrupted = False
    try:
        yield
    except KeyboardInterrupt:
        interrupted = True
        raise
    finally:
        if record.frames:
            facts = {
                **record.facts(),
                "interrupted": interrupted,
                **weights_facts(args.weights),
                "versions": versions(),
                "config": setting.config.as_dict(),
                "arguments": given(args),
            }
            write_json(path, facts)


def _movie(path: Path, fps: float | None, left_out: bool) -> AbstractContextManager[Any]:
    from ..visualization.video import VideoWriter

    return nullcontext() if left_out else VideoWriter(path, fps or 25.0)


def _verdict(record: TrackSummary, output: Path) -> int:
    if record.failed == record.frames:
        first = record.failures[0]["error"] if record.failures else "there was no frame."
        raise InputError(f"no frame could be tracked; the first says: {first}")
    pace = record.facts()["median_milliseconds"]
    text = f"{record.frames} frames, {record.failed} failed, {pace:.0f} ms a frame"
    if record.lost_from is not None:
        text += f", perhaps lost from frame {record.lost_from}"
    print(f"{text}: {output}")
    return 0
