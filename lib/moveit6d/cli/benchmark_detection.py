"""`moveit6d benchmark detection`, `recovery` and `motion`: finding, losing, and what motion costs.

Never more than arguments, loops over files and printing.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path
from typing import Any

from ..errors import InputError
from . import track
from .apart import check_apart, check_chart, files_of_sequences, given_paths
from .common import (
    UNITS,
    Setting,
    add_tracking_options,
    add_untextured_option,
    add_verb,
    make_tools,
    mesh_or_demo,
    new_folder,
    positive,
    seed,
)
from .detect import TEMPLATES
from .messages import note, progress
from .settings import SettingsPart

# The settings that decide about a search of the whole image.
READ = SettingsPart(TEMPLATES.names, but=(*TEMPLATES.but, "detection.region"))
FASTEST = 1000  # pixels a frame: beyond any picture
DETECTION = """\
Looks for the object of every sequence in single frames, from nothing, and prints how often ADD(-S)
is below 10 % of the diameter; a frame that cannot be read counts as one without a pose. With
--photos and --objects it also looks for every object in photos without it, and prints how often a
pose is claimed.
"""

DETECTION_EXAMPLES = """\
examples:
  moveit6d benchmark detection --sequences sequences --every 20
  moveit6d benchmark detection --photos photos --objects meshes --limit 20
"""

RECOVERY = """\
Tracks every sequence with an exact start while frames 40 to 69, counted from that of the start, are
other pictures, and prints how often the object is found again, known to be lost, claimed where it
is not, and known to be tracked.
"""

RECOVERY_EXAMPLES = """\
examples:
  moveit6d benchmark recovery --sequences sequences --photos photos --output out/cuts
"""


MOTION = """\
Tracks one object, procedural if no --mesh is given, in synthetic sequences of increasing speed,
and prints how many iterations a frame takes: a still object costs one. --chart NAME draws them
against the speed as NAME.png and NAME.svg.
"""

MOTION_EXAMPLES = """\
examples:
  moveit6d benchmark motion --speeds 0 1 2 5 10 20 --frames 40 --chart motion
"""


def add_kinds(kinds: Any) -> None:
    """Add the kinds."""
    one = add_verb(kinds, "detection", "find objects from nothing", DETECTION, DETECTION_EXAMPLES)
    one.add_argument("--sequences", type=Path, metavar="DIR", help="sequence folders")
    one.add_argument("--every", type=positive, default=20, metavar="N", help="frames from 0 on")
    one.add_argument("--photos", type=Path, metavar="DIR", help="pictures without the objects")
    one.add_argument("--objects", type=Path, metavar="DIR", help="meshes, metres")
    one.add_argument("--limit", type=positive, metavar="N", help="photos at most, evenly chosen")
    add_untextured_option(one)
    add_tracking_options(one, part=READ)
    one.set_defaults(run=run_detection)
    two = add_verb(kinds, "recovery", "lose objects and find them", RECOVERY, RECOVERY_EXAMPLES)
    two.add_argument("--sequences", type=Path, required=True, metavar="DIR", help="folders")
    two.add_argument("--photos", type=Path, required=True, metavar="DIR", help="other pictures")
    two.add_argument("--output", type=Path, required=True, metavar="DIR", help="NAME.csv each")
    add_tracking_options(two, part=track.READ)
    two.set_defaults(run=run_recovery)
    three = add_verb(kinds, "motion", "iterations by speed", MOTION, MOTION_EXAMPLES)
    three.add_argument("--mesh", type=Path, metavar="FILE", help="the object")
    three.add_argument("--mesh_unit", choices=UNITS, help="the mesh's unit (default: m)")
    three.add_argument(
        "--speeds", type=float, nargs="+", default=[0.0, 1.0, 2.0, 5.0, 10.0, 20.0], metavar="PX",
        help="pixels a frame",
    )  # fmt: skip
    three.add_argument("--frames", type=positive, default=40, metavar="N", help="of each")
    three.add_argument("--seed", type=seed, default=0, metavar="N", help="of the sequences")
    three.add_argument(
        "--chart", type=Path, metavar="NAME", help="curves of the table: NAME.png, NAME.svg"
    )
    add_untextured_option(three)
    add_tracking_options(three, part=track.READ)
    three.set_defaults(run=run_motion)


def run_detection(args: argparse.Namespace) -> int:
    """Detect, and print the tables."""
    from ..datasets.sequences import read_sequences
    from ..estimation import PoseDetector, TemplateStore
    from ..evaluation.detection_scores import (
        DetectedFrame,
        detect_in_photos,
        detect_in_sequence,
        detection_table,
    )
    from ..geometry.mesh import Mesh
    from ..synthesis.training.source import mesh_files

    if args.sequences is None and (args.photos is None or args.objects is None):
        raise InputError("give --sequences, or --photos and --objects, or all three.")
    setting = Setting.of(args)
    policy, renderer = make_tools(setting)
    make = partial(
        PoseDetector,
        policy=policy,
        renderer=renderer,
        config=setting.config,
        store=TemplateStore(),
        threads=setting.threads,
    )
    accepted = setting.config.detection.accepted
    if args.sequences is not None:
        found: list[DetectedFrame] = []
        videos = read_sequences(args.sequences)
        for video in progress(videos, len(videos), "detect", "sequence"):
            frames = range(0, max(video.truth) + 1, args.every)
            found += detect_in_sequence(video, frames, make)
        if not found:
            raise InputError(
                f"{args.sequences}: no frame whose number is a multiple "
                f"of {args.every} has a true pose; give a smaller --every."
            )
        print(detection_table(found, accepted))
    if args.photos is not None and args.objects is not None:
        photos = _photos(args.photos, args.limit)
        claims: list[DetectedFrame] = []
        meshes = mesh_files(args.objects)
        for path in progress(meshes, len(meshes), "photos", "object"):
            mesh = Mesh.load(path, allow_untextured=args.allow_untextured)
            claims += detect_in_photos(photos, mesh, make)
        print(detection_table(claims, accepted))
    return 0


def run_recovery(args: argparse.Namespace) -> int:
    """Track the cut sequences, keep the tracks, print the table."""
    from ..datasets.pose_files import write_poses
    from ..datasets.sequences import read_sequences
    from ..evaluation.recovery_scores import (
        RecoveryScore,
        cut,
        recovery_table,
        score_recovery,
    )
    from ..evaluation.run_tracker import run_tracker
    from ..evaluation.runner import TrackJob, tracker_and_frames
    from ..evaluation.track_scores import EvaluationPoints

    videos, output = read_sequences(args.sequences), args.output
    written = [output / f"{video.name}.csv" for video in videos]
    check_apart({"--output": written}, [*given_paths(args, "output"), *files_of_sequences(videos)])
    setting = Setting.of(args)
    policy, renderer = make_tools(setting)
    photos = [image for _, image in _photos(args.photos, None)]
    new_folder(output)
    scores: dict[str, RecoveryScore] = {}
    for number, video in enumerate(progress(videos, len(videos), "track", "sequence")):
        job = TrackJob(sequence=video, config=setting.config, threads=setting.threads)
        tracker, frames = tracker_and_frames(job, policy, renderer)
        frames = cut(frames, photos, number, video.first)
        rows = {step.frame.index: step.row for step in run_tracker(tracker, frames)}
        if not rows:
            raise InputError(f"{video.folder}: there is no frame {video.first}, that of the start.")
        write_poses(output / f"{video.name}.csv", list(rows.values()))
        surface = EvaluationPoints.of(video.load_mesh(), symmetric=video.symmetric)
        one = score_recovery(rows, video.truth, surface, video.first)
        scores[video.level] = scores[video.level] + one if video.level in scores else one
        print(recovery_table({video.name: one}).splitlines()[2], flush=True)
    print(recovery_table(scores))
    return 0


def run_motion(args: argparse.Namespace) -> int:
    """Track at every speed and print the table."""
    from ..evaluation.motion_cost import motion_costs, motion_table
    from ..visualization.charts import motion_chart
    from ..visualization.plots import draw

    if args.frames < 2 or not all(0 <= speed <= FASTEST for speed in args.speeds):
        raise InputError(f"--frames must be 2 or more and --speeds from 0 to {FASTEST}.")
    check_chart(args, "chart")
    mesh = mesh_or_demo(args)
    setting = Setting.of(args)
    policy, renderer = make_tools(setting)
    costs = list(progress(motion_costs(
        mesh, args.speeds, args.frames, policy, renderer, args.seed, setting.config,
        setting.threads,
    ), len(args.speeds), "motion", "speed"))  # fmt: skip
    print(motion_table(costs))
    if args.chart is not None:
        curves = [c.pixels for c in costs], [c.iterations for c in costs], [c.still for c in costs]
        written = draw(motion_chart(args.chart.name, *curves), args.chart.parent)
        print(f"\n{', '.join(map(str, written))}")
    return 0


def _photos(folder: Path, limit: int | None) -> list[tuple[str, Any]]:
    """Names and pictures of a folder, evenly chosen."""
    from ..datasets.video import open_frames

    frames = list(open_frames(folder / "*"))
    found = [(f.name, f.image) for f in frames if f.image is not None]
    if not found:
        raise InputError(f"{folder}: no picture can be read; give a folder of photographs.")
    if len(found) < len(frames):
        note(f"{folder}: {len(frames) - len(found)} of {len(frames)} pictures cannot be read.")
    if limit is None or limit >= len(found):
        return found
    return [found[round(k * (len(found) - 1) / max(limit - 1, 1))] for k in range(limit)]
