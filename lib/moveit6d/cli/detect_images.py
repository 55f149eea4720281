"""`moveit6d detect --image`: the object in pictures, one after the other, on disk at once.

Never tracks.
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
from .apart import check_apart, check_truth, given_paths
from .camera_options import camera_of
from .common import (
    NOT_FOUND,
    Setting,
    given,
    make_tools,
    new_folder,
    run_facts,
    versions,
    weights_facts,
)
from .detect import SEEDS, TEMPLATES
from .earlier import DETECTION, TABLE, clear_detection, clear_earlier
from .journal import Journal, file_facts, journal_file, pose_line, pose_of
from .messages import note, progress
from .narrowing import advice, known_of, unconfirmed
from .seed_options import DEST, given_seed_options, seeds_of
from .settings import check_settings

if TYPE_CHECKING:
    from ..datasets.pose_files import PoseRow
    from ..datasets.video import VideoFrame
    from ..estimation.detection import Detection, PoseDetector
    from ..geometry.camera import Camera
    from ..geometry.mesh import Mesh
    from ..geometry.pose import Pose

POINTS_ERROR = "points_error_pixels"  # in detection.json, where the points alone say the pose


@dataclass(frozen=True)
class _Answer:
    """What was found in one image: poses with their probability, and facts for detection.json.

    `error` says why an image could not be used.
    """

    poses: tuple[tuple[Pose, float, int], ...]  # pose, probability, iterations
    best: float = 0.0
    milliseconds: float | None = None
    facts: dict[str, Any] | None = None
    error: str | None = None


def run(args: argparse.Namespace) -> int:
    """Detect in image after image; what was found is on disk whatever ends the run."""
    from ..datasets.pose_files import PoseWriter
    from ..datasets.video import ImageList, read_image
    from ..frame import check_size
    from ..geometry.mesh import Mesh

    _check_options(args)
    mesh = Mesh.load(args.mesh, args.mesh_unit, allow_untextured=args.allow_untextured)
    images = ImageList(tuple(args.image))
    _check_images(images.paths)
    _check_output(args)
    camera, known = camera_of(args, images), _known(args, mesh)
    if len(images.paths) == 1:
        height, width = read_image(images.paths[0]).shape[:2]
        check_size(str(images.paths[0]), width, height, camera)
    output = new_folder(args.output)
    setting = Setting.of(args)
    detector = _detector(args, setting, mesh, camera)
    single, answers = len(images.paths) == 1, list[_Answer]()
    with Journal(output / TABLE, _facts_of_run(args, setting), args.resume) as journal:
        with PoseWriter(output / TABLE) as table:
            try:
                for frame in progress(images, len(images.paths), "detect", "image"):
                    if frame.index < len(journal.entries):
                        answer = _from_line(journal.entries[frame.index])
                    else:
                        answer = _answered(detector, frame, args, known, single)
                        if not frame.index:  # until now all of an earlier run's stays
                            _clear(output)
                        journal.add(_line(answer))
                        _draw(output / _picture(args, frame.index), frame, answer, detector)
                    answers.append(answer)
                    for row in _rows(frame, answer):
                        table.write(row)
            finally:
                if answers:
                    _write_facts(args, answers, output, detector)
        if single:
            for number, (pose, *_) in enumerate(answers[0].poses):
                pose.save(output / _pose_file(number))
        journal.finish()
    return _verdict(args, answers, output)


def _check_images(paths: Sequence[Path]) -> None:
    """What is no image at all is said before the work."""
    from ..datasets.video import image_size

    for path in paths:
        if path.is_dir():
            raise InputError(f"--image {path} is a folder; give its pictures, {path / '*'}.")
        image_size(path)


def _check_options(args: argparse.Namespace) -> None:
    """`InputError` for options that the method does not read."""
    if args.method == "seeds":
        check_settings(args, SEEDS, "with --method seeds")
        return
    seeds = given_seed_options(args)
    if seeds:
        raise InputError(f"{', '.join(seeds)} is for --method seeds.")
    check_settings(args, TEMPLATES, "without --method seeds")


def _check_output(args: argparse.Namespace) -> None:
    """`InputError` where what is written would destroy an input, or be taken for a frame."""
    output, count = args.output, len(args.image)
    names = [TABLE, DETECTION, *(_picture(args, index) for index in range(count))]
    names += [_pose_file(number) for number in range(args.instances if count == 1 else 1)]
    written = [*(output / name for name in names), journal_file(output / TABLE)]
    check_apart({"--output": written}, given_paths(args, "output"))
    check_truth(output, args.image)
    if count == 1 and _is_video(output, args.image[0]):
        raise InputError(
            f"--output: {output} holds {args.image[0].name} and other pictures of its kind, among "
            "which overlay.png would be a frame; give another folder."
        )


def _is_video(folder: Path, image: Path) -> bool:
    """Whether a folder holds an image and others that `--video` would read with it."""
    if folder.resolve() != image.resolve().parent:
        return False
    own = (image.name, "overlay.png")
    return any(path.suffix == image.suffix and path.name not in own for path in folder.iterdir())


def _clear(output: Path) -> None:
    """Remove an earlier run's files, so that none stays beside those of another."""
    clear_earlier(output, ())  # a track's summary would vouch for these poses
    clear_detection(output)


def _facts_of_run(args: argparse.Namespace, setting: Setting) -> dict[str, Any]:
    """What the poses depend on: a run with other facts cannot be gone on with."""
    names = (
        "mesh", "mesh_unit", "image", "camera", "fov", "instances", "box", "mask", "points",
        "distance", "start", "method",
    )  # fmt: skip
    known = {
        key: value for key, value in given(args).items() if key in names or key.startswith(DEST)
    }
    return {**known, **file_facts(args), **run_facts(setting)}


def _write_facts(
    args: argparse.Namespace, answers: Sequence[_Answer], output: Path, detector: PoseDetector
) -> None:
    from ..io import write_json

    images = [
        {
            "image": str(path),
            "milliseconds": answer.milliseconds and round(answer.milliseconds, 1),
            **(answer.facts or {"error": answer.error}),
        }
        for path, answer in zip(args.image, answers, strict=False)
    ]
    facts = {
        "images": images,
        "files": _files(args, answers),
        **weights_facts(args.weights),
        "versions": versions(),
        "config": detector.settings.as_dict(),
        "arguments": given(args),
    }
    write_json(output / DETECTION, facts)


def _verdict(args: argparse.Namespace, answers: Sequence[_Answer], output: Path) -> int:
    if all(answer.error for answer in answers):
        raise InputError(f"no image could be used; the first says: {answers[0].error}")
    found = sum(bool(answer.poses) for answer in answers)
    best = max(answer.best for answer in answers)
    if not found:
        what = str(args.image[0]) if len(answers) == 1 else f"{len(answers)} images"
        print(
            f"moveit6d: {what}: the object was not found (probability of the best pose "
            f"{best:.2f}){advice(args)}.",
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

    unsure = answer.error is not None or POINTS_ERROR in (answer.facts or {})
    if not answer.poses:
        state = "uncertain" if unsure else "lost"
        return [
            PoseRow(
                frame.index, frame.name, stopped_by="failed", confidence=answer.best,
                milliseconds=answer.milliseconds, state=state,
            )
        ]  # fmt: skip
    state = "uncertain" if unsure else "tracking"
    return [
        PoseRow(
            frame.index, frame.name, pose, iterations, "max_iterations", probability,
            answer.milliseconds, state=state,
        )
        for pose, probability, iterations in answer.poses
    ]  # fmt: skip


def _picture(args: argparse.Namespace, index: int) -> str:
    """Where an image is drawn; those of one name, from several folders, get their number."""
    if len(args.image) == 1:
        return "overlay.png"
    name = args.image[index].name
    twice = [path.name for path in args.image].count(name) > 1
    return f"overlay/{index:06d}_{name}.png" if twice else f"overlay/{name}.png"


def _pose_file(number: int) -> str:
    """Where the pose of an instance is written, the most probable one first."""
    return f"pose_{number + 1}.json" if number else "pose.json"


def _files(args: argparse.Namespace, answers: Sequence[_Answer]) -> list[str]:
    """The files of these answers in --output, by which a later run knows them as its own."""
    drawn = [_picture(args, k) for k, answer in enumerate(answers) if not answer.error]
    poses = answers[0].poses if len(args.image) == 1 else ()
    return [TABLE, DETECTION, *drawn, *(_pose_file(number) for number in range(len(poses)))]


def _draw(path: Path, frame: VideoFrame, answer: _Answer, detector: PoseDetector) -> None:
    from PIL import Image

    from ..io import replacing
    from ..visualization.overlay import draw_pose

    image = frame.image
    if image is None or answer.error:
        return
    for pose, *_ in answer.poses:
        image = draw_pose(image, detector.mesh, pose, detector.camera, detector.renderer)
    with replacing(path) as temporary:
        Image.fromarray(image).save(temporary, format="PNG")


def _detector(
    args: argparse.Namespace, setting: Setting, mesh: Mesh, camera: Camera
) -> PoseDetector:
    """By the options."""
    from ..estimation import PoseDetector, TemplateStore
    from ..estimation.detection import default_store

    if args.method == "seeds" and len(args.image) > 1:
        raise InputError("--method seeds takes one --image.")
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


def _known(args: argparse.Namespace, mesh: Mesh) -> dict[str, Any]:
    """What is known of where the object is, as `PoseDetector.detect` takes it."""
    from ..geometry.pose import Pose, in_metres

    start = None
    if args.start is not None:
        start = in_metres(Pose.load(args.start), str(args.start), mesh.center)
    return {**known_of(args, args.mesh_unit), "start": start}


def _answered(
    detector: PoseDetector,
    frame: VideoFrame,
    args: argparse.Namespace,
    known: dict[str, Any],
    single: bool,
) -> _Answer:
    """What is found in one image; of several, one that cannot be used does not stop the others."""
    try:
        if frame.image is None:
            raise InputError(str(frame.error))
        return _detected(detector, frame, args.instances, known)
    except InputError as error:
        if single:
            raise
        note(f"{frame.name}: {error}")
        return _Answer((), error=str(error))


def _detected(
    detector: PoseDetector, frame: VideoFrame, instances: int, known: dict[str, Any]
) -> _Answer:
    assert frame.image is not None
    begin = time.perf_counter()
    found = detector.detect(frame.image, instances=instances, **known)
    spent = (time.perf_counter() - begin) * 1e3
    poses = tuple((one.pose, one.probability, one.result.iterations) for one in found.instances)
    facts = _facts(found)
    if known["points"] is not None and not poses:
        pose, error = unconfirmed(known["points"], detector.camera, found, frame.name)
        poses = ((pose, found.probability, 0),)
        facts[POINTS_ERROR] = round(error, 2)
    return _Answer(poses, found.probability, spent, facts)


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


def _line(answer: _Answer) -> dict[str, Any]:
    """What a journal keeps of an answer, exactly."""
    return {**vars(answer), "poses": [[pose_line(pose), *more] for pose, *more in answer.poses]}


def _from_line(line: dict[str, Any]) -> _Answer:
    poses = tuple(
        (pose_of(pose), probability, iterations) for pose, probability, iterations in line["poses"]
    )
    return _Answer(**{**line, "poses": poses})
