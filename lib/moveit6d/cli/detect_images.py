"""`moveit6d detect --image`: objects in pictures, one after the other, on disk at once.

Never tracks.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .apart import check_apart, check_truth, given_paths
from .camera_options import camera_of
from .common import Setting, given, new_folder, run_facts, versions, weights_facts
from .detect import SEEDS, TEMPLATES
from .detect_answers import (
    POINTS_ERROR,
    Answer,
    answer_line,
    answer_of,
    columns,
    detection_facts,
    pose_file,
    rows,
)
from .detect_search import ImageSearch, check_objects, image_search, known_by
from .detect_verdict import verdict
from .earlier import DETECTION, TABLE, clear_detection, clear_earlier
from .journal import Journal, file_facts, journal_file
from .messages import note, progress
from .narrowing import unconfirmed
from .objects import load_meshes, object_names
from .seed_options import DEST, given_seed_options
from .settings import check_settings

if TYPE_CHECKING:
    from ..datasets.video import VideoFrame

Answers = list[Answer]  # of one image, one an object


def run(args: argparse.Namespace) -> int:
    """Detect in image after image; what was found is on disk whatever ends the run."""
    from ..datasets.pose_files import PoseWriter
    from ..datasets.video import ImageList
    from ..frame import check_size

    _check_options(args)
    check_objects(args)
    meshes, images = load_meshes(args), ImageList(tuple(args.image))
    _check_images(images.paths)
    _check_output(args)
    camera, known = camera_of(args, images), known_by(args, meshes)
    single = len(images.paths) == 1
    if single:
        only = images.frame(0)
        if only.image is None:
            raise InputError(str(only.error))
        check_size(str(images.paths[0]), only.image.shape[1], only.image.shape[0], camera)
    output, setting = new_folder(args.output), Setting.of(args)
    search, answers = image_search(args, setting, meshes, camera, known), list[Answers]()
    with Journal(output / TABLE, _facts_of_run(args, setting), args.resume) as journal:
        with PoseWriter(output / TABLE, columns(len(meshes), args.instances)) as table:
            try:
                for frame in progress(images, len(images.paths), "detect", "image"):
                    if frame.index < len(journal.entries):
                        found = [answer_of(line) for line in journal.entries[frame.index]]
                    else:
                        found = _answered(search, frame, single)
                        if not frame.index:  # until now all of an earlier run's stays
                            _clear(output)
                        journal.add([answer_line(answer) for answer in found])
                        _draw(output / _picture(args, frame.index), frame, found, search)
                    answers.append(found)
                    for name, answer in zip(search.names, found, strict=True):
                        for row in rows(frame, name, answer):
                            table.write(row)
            finally:
                if answers:
                    _write_facts(args, answers, output, search)
        if single:
            for name, answer in zip(search.names, answers[0], strict=True):
                for number, (pose, *_) in enumerate(answer.poses):
                    pose.save(output / pose_file(name, number))
        journal.finish()
    return verdict(args, search.names, meshes, answers)


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
    poses = [
        pose_file(name, number)
        for name in object_names(args.mesh)
        for number in range(args.instances if count == 1 else 1)
    ]
    twice = next((name for name in poses if poses.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"Two poses would be written to {twice}; give a mesh another name.")
    names += poses
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
    args: argparse.Namespace, answers: Sequence[Answers], output: Path, search: ImageSearch
) -> None:
    from ..io import write_json

    images = [
        _facts_of_image(path, found, search.names)
        for path, found in zip(args.image, answers, strict=False)
    ]
    facts = {
        "images": images,
        "files": _files(args, answers, search.names),
        **weights_facts(args.weights),
        "versions": versions(),
        "config": search.detectors[0].settings.as_dict(),
        "arguments": given(args),
    }
    write_json(output / DETECTION, facts)


def _facts_of_image(path: Path, found: Answers, names: Sequence[str]) -> dict[str, Any]:
    """What detection.json says of an image: its error, or what was found; of several by name."""
    first = found[0]
    facts: dict[str, Any] = first.facts or {"error": first.error}
    if len(found) > 1 and not first.error:
        facts = {"objects": {name: one.facts for name, one in zip(names, found, strict=True)}}
    time = first.milliseconds and round(first.milliseconds, 1)
    return {"image": str(path), "milliseconds": time, **facts}


def _picture(args: argparse.Namespace, index: int) -> str:
    """Where an image is drawn; those of one name, from several folders, get their number."""
    if len(args.image) == 1:
        return "overlay.png"
    name = args.image[index].name
    twice = [path.name for path in args.image].count(name) > 1
    return f"overlay/{index:06d}_{name}.png" if twice else f"overlay/{name}.png"


def _files(args: argparse.Namespace, answers: Sequence[Answers], names: Sequence[str]) -> list[str]:
    """The files of these answers in --output, by which a later run knows them as its own."""
    drawn = [_picture(args, k) for k, found in enumerate(answers) if not found[0].error]
    poses = [
        pose_file(name, number)
        for name, one in zip(names, answers[0], strict=True)
        for number in range(len(one.poses))
        if len(args.image) == 1
    ]
    return [TABLE, DETECTION, *drawn, *poses]


def _draw(path: Path, frame: VideoFrame, found: Answers, search: ImageSearch) -> None:
    from PIL import Image

    from ..io import replacing
    from ..visualization.overlay import draw_pose

    image = frame.image
    if image is None or found[0].error:
        return
    for answer, one in zip(found, search.detectors, strict=True):
        for pose, *_ in answer.poses:
            image = draw_pose(image, one.mesh, pose, one.camera, one.renderer)
    with replacing(path) as temporary:
        Image.fromarray(image).save(temporary, format="PNG")


def _answered(search: ImageSearch, frame: VideoFrame, single: bool) -> Answers:
    """What is found in one image; of several, one that cannot be used does not stop the others."""
    try:
        if frame.image is None:
            raise InputError(str(frame.error))
        return _detected(search, frame)
    except InputError as error:
        if single:
            raise
        note(f"{frame.name}: {error}")
        return [Answer((), error=str(error)) for _ in search.names]


def _detected(search: ImageSearch, frame: VideoFrame) -> Answers:
    """What is found of each object; the time is that of all of them."""
    assert frame.image is not None
    begin = time.perf_counter()
    detections = search.detections(frame.image)
    spent = (time.perf_counter() - begin) * 1e3
    answers, points = [], search.known["points"]
    for found, detector in zip(detections, search.detectors, strict=True):
        poses = tuple(
            (one.pose, one.probability, one.result.iterations, str(one.result.stopped_by))
            for one in found.instances
        )
        facts = detection_facts(found)
        if points is not None and not poses:
            pose, error = unconfirmed(points, detector.camera, found, frame.name)
            poses = ((pose, found.probability, 0, ""),)
            facts[POINTS_ERROR] = round(error, 2)
        answers.append(Answer(poses, found.probability, spent, facts))
    return answers
