"""`moveit6d detect`: find objects in images, without a start or with what is known.

Never tracks; what it writes is what `moveit6d track --start` reads.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..config import SeedDetectorConfig
from ..errors import InputError
from .camera_options import add_camera_options, camera_of
from .common import (
    UNITS,
    Setting,
    add_tracking_options,
    add_untextured_option,
    add_verb,
    given,
    make_tools,
    new_folder,
    positive,
    versions,
    weights_facts,
)
from .messages import progress
from .seed_options import add_seed_options, seeds_of

if TYPE_CHECKING:
    from ..datasets.pose_files import PoseRow
    from ..datasets.video import VideoFrame
    from ..estimation.detection import Detection, PoseDetector
    from ..geometry.camera import Camera
    from ..geometry.mesh import Mesh
    from ..geometry.pose import Pose

NOT_FOUND = 3

DESCRIPTION = """\
Compares every place in the image, at every size, with the object seen from all sides, refines the
best candidates and judges them. Whether the object is there is part of the answer. It takes about a
second an image, after a second or two of preparation, which is kept for the next call. What is
known of where the object is makes it faster and surer: --box, --mask, --points, --distance and
--start.

files written to --output:
  poses.csv     the columns of `moveit6d track`, a row an image in the order given (more with
                --instances); empty numbers and the state `lost` where the object was not found;
                `confidence` is the probability that the pose is right
  pose.json     for one image: the pose found, start of `moveit6d track`
  overlay.png   outline and axes drawn on the image; for several images overlay/NAME.png
  detection.json  probabilities, what speaks for the poses, versions

with --dataset, --split and --targets, --output is a BOP result file with a pose for every target.

exit code 3 also says that the object was found in none of the images.
"""

EPILOG = """\
examples:
  moveit6d detect --mesh drill.glb --mesh_unit m --image frames/000000.jpg \\
      --camera camera.json --output found
  moveit6d detect --mesh drill.glb --mesh_unit m --image a.png b.png --camera camera.json \\
      --box 210 140 180 160 --distance 0.4 1.2 --output found
  moveit6d detect --dataset lmo --split test --targets test_targets_bop19.json \\
      --output results.csv
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(verbs, "detect", "find objects in images", DESCRIPTION, EPILOG)
    parser.add_argument("--output", type=Path, required=True, metavar="PATH", help="for results")
    images = parser.add_argument_group("images")
    images.add_argument("--mesh", type=Path, metavar="FILE", help="the object")
    images.add_argument("--mesh_unit", choices=UNITS, help="the mesh's unit")
    images.add_argument("--image", type=Path, nargs="+", metavar="FILE", help="the pictures")
    add_camera_options(images, required=False)
    images.add_argument(
        "--instances", type=positive, default=1, metavar="N", help="of the object in an image"
    )
    dataset = parser.add_argument_group("data set")
    dataset.add_argument("--dataset", type=Path, metavar="DIR", help="BOP data set")
    dataset.add_argument("--split", metavar="NAME", help="folder in it, as test")
    dataset.add_argument("--targets", type=Path, metavar="FILE", help="what is to be found")
    add_narrowing_options(parser)
    parser.add_argument(
        "--method",
        choices=("templates", "seeds"),
        default="templates",
        help="templates compares with the object seen from all sides; seeds is the paper's way, "
        "by where single iterations lead: one image, no narrowing, minutes",
    )
    add_seed_options(parser, SeedDetectorConfig())
    add_tracking_options(parser)
    add_untextured_option(parser)
    parser.set_defaults(run=run)


def add_narrowing_options(parser: argparse.ArgumentParser) -> None:
    """What is known of where the object is."""
    known = parser.add_argument_group("what is known")
    known.add_argument(
        "--box",
        type=float,
        nargs=4,
        metavar=("X", "Y", "W", "H"),
        help="left, top, width and height, pixels, around what is visible of the object",
    )
    known.add_argument(
        "--mask", type=Path, metavar="FILE", help="picture that is not black on the object"
    )
    known.add_argument(
        "--points",
        type=Path,
        metavar="FILE",
        help="CSV of four or more rows u,v,x,y,z: pixels, and where they are in the mesh file",
    )
    known.add_argument(
        "--distance",
        type=float,
        nargs=2,
        metavar=("MIN", "MAX"),
        help="metres from the camera to the object",
    )
    known.add_argument("--start", type=Path, metavar="FILE", help="a pose that is roughly right")


def run(args: argparse.Namespace) -> int:
    """Detect and write."""
    if args.dataset is not None:
        from .detect_dataset import run as run_dataset

        return run_dataset(args)
    missing = [
        f"--{name}" for name in ("mesh", "mesh_unit", "image") if getattr(args, name) is None
    ]
    if args.camera is None and args.fov is None:
        missing.append("--camera")
    if missing:
        raise InputError(
            f"{', '.join(missing)} missing: --mesh, --mesh_unit, --image and --camera (or --fov) "
            "are needed, or --dataset, --split and --targets."
        )
    return _detect_images(args)


@dataclass(frozen=True)
class _Answer:
    """What was found in one image: poses with their probability, and facts for detection.json."""

    poses: tuple[tuple[Pose, float, int], ...]  # pose, probability, iterations
    best: float
    milliseconds: float
    facts: dict[str, Any]


def _detect_images(args: argparse.Namespace) -> int:
    from ..datasets.pose_files import PoseWriter
    from ..datasets.video import ImageList
    from ..geometry.mesh import Mesh
    from ..io import check_writable, write_json

    mesh = Mesh.load(args.mesh, args.mesh_unit, allow_untextured=args.allow_untextured)
    images = ImageList(tuple(args.image))
    camera, frames = camera_of(args, images), list(images)
    for frame in frames:
        if frame.image is None:
            raise InputError(str(frame.error))
    output = new_folder(args.output)
    check_writable(output / "poses.csv")
    detector, known = _detector(args, mesh, camera), _known(args)
    answers = [
        _detected(detector, frame, args.instances, known)
        for frame in progress(frames, len(frames), "detect", "image")
    ]
    with PoseWriter(output / "poses.csv") as table:
        for frame, answer in zip(frames, answers, strict=True):
            for row in _rows(frame, answer):
                table.write(row)
    single = len(frames) == 1
    if single and answers[0].poses:
        answers[0].poses[0][0].save(output / "pose.json")
    for frame, answer in zip(frames, answers, strict=True):
        path = output / "overlay.png" if single else output / "overlay" / f"{frame.name}.png"
        _draw(path, frame, [pose for pose, *_ in answer.poses], detector)
    facts = {
        "images": [
            {"image": str(path), "milliseconds": round(answer.milliseconds, 1), **answer.facts}
            for path, answer in zip(args.image, answers, strict=True)
        ],
        **weights_facts(args.weights),
        "versions": versions(),
        "config": detector.settings.as_dict(),
        "arguments": given(args),
    }
    write_json(output / "detection.json", facts)
    return _verdict(args, answers, output)


def _verdict(args: argparse.Namespace, answers: Sequence[_Answer], output: Path) -> int:
    found = sum(bool(answer.poses) for answer in answers)
    best = max(answer.best for answer in answers)
    if not found:
        what = str(args.image[0]) if len(answers) == 1 else f"{len(answers)} images"
        print(
            f"moveit6d: {what}: the object was not found (probability of the best pose "
            f"{best:.2f}); narrow the search by --box, --mask, --points or --distance.",
            file=sys.stderr,
        )
        return NOT_FOUND
    if len(answers) == 1:
        print(f"probability {best:.2f}: {output / 'pose.json'}")
    else:
        print(f"found in {found} of {len(answers)} images: {output / 'poses.csv'}")
    return 0


def _rows(frame: VideoFrame, answer: _Answer) -> list[PoseRow]:
    """A row for each instance; one without a pose if there is none."""
    from ..datasets.pose_files import PoseRow

    if not answer.poses:
        return [
            PoseRow(
                frame.index, frame.name, stopped_by="failed", confidence=answer.best,
                milliseconds=answer.milliseconds, state="lost",
            )
        ]  # fmt: skip
    return [
        PoseRow(
            frame.index, frame.name, pose, iterations, "max_iterations", probability,
            answer.milliseconds, state="tracking",
        )
        for pose, probability, iterations in answer.poses
    ]  # fmt: skip


def _draw(path: Path, frame: VideoFrame, poses: Sequence[Pose], detector: PoseDetector) -> None:
    from PIL import Image

    from ..io import replacing
    from ..visualization.overlay import draw_pose

    image = frame.image
    assert image is not None
    for pose in poses:
        image = draw_pose(image, detector.mesh, pose, detector.camera, detector.renderer)
    path.parent.mkdir(parents=True, exist_ok=True)
    with replacing(path) as temporary:
        Image.fromarray(image).save(temporary, format="PNG")


def _detector(args: argparse.Namespace, mesh: Mesh, camera: Camera) -> PoseDetector:
    """By the options."""
    from ..estimation import PoseDetector, TemplateStore
    from ..estimation.detection import default_store

    if args.method == "seeds" and len(args.image) > 1:
        raise InputError("--method seeds takes one --image.")
    setting = Setting.of(args)
    policy, renderer = make_tools(setting)
    return PoseDetector(
        mesh,
        camera,
        policy=policy,
        renderer=renderer,
        config=setting.config,
        method=args.method,
        seeds=seeds_of(args, SeedDetectorConfig(), setting.config.loop),
        store=TemplateStore(default_store()),
        threads=setting.threads,
    )


def _known(args: argparse.Namespace) -> dict[str, Any]:
    """What is known of where the object is, as `PoseDetector.detect` takes it."""
    from ..estimation.detection.points import read_points
    from ..geometry.pose import Pose

    return {
        "box": args.box,
        "mask": None if args.mask is None else read_mask(args.mask),
        "points": None if args.points is None else read_points(args.points, args.mesh_unit),
        "distance": args.distance,
        "start": None if args.start is None else Pose.load(args.start),
    }


def _detected(
    detector: PoseDetector, frame: VideoFrame, instances: int, known: dict[str, Any]
) -> _Answer:
    """What is found in one image."""
    assert frame.image is not None
    begin = time.perf_counter()
    found = detector.detect(frame.image, instances=instances, **known)
    spent = (time.perf_counter() - begin) * 1e3
    poses = tuple((one.pose, one.probability, one.result.iterations) for one in found.instances)
    return _Answer(poses, found.probability, spent, _facts(found))


def _facts(found: Detection) -> dict[str, Any]:
    """What detection.json says of an image."""
    if found.seeds is not None:
        sinks = [
            {"pixel": sink.centre.tolist(), "strength": sink.strength, "size": sink.size}
            for place in found.seeds.places
            for sink in place
        ]
        return {"candidates": len(found.seeds.candidates), "sinks": sinks}
    poses = [
        {
            "probability": round(one.probability, 4),
            "accepted": number < len(found.instances),
            **{name: round(value, 4) for name, value in vars(one.evidence).items()},
        }
        for number, one in enumerate((*found.instances, *found.rejected))
    ]
    return {"poses": poses}


def read_mask(path: Path) -> Any:
    """A mask picture (H, W), not zero on the object; alpha is ignored."""
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as opened:
            import numpy as np

            return np.asarray(opened.convert("L")) > 0
    except (OSError, UnidentifiedImageError, ValueError) as error:
        raise InputError(f"{path} cannot be read as a picture of a mask: {error}.") from error
