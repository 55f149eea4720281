"""`moveit6d detect --dataset`: every target of a BOP data set, as a BOP result file.

Never looks at true poses.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .apart import check_result
from .common import Setting, make_tools, run_facts, targets_file
from .detect import TEMPLATES
from .journal import Journal, estimate_line, estimate_of
from .messages import note, progress
from .seed_options import given_seed_options
from .settings import check_settings

if TYPE_CHECKING:
    from ..datasets.bop import BopDataset, BopTarget, Estimate
    from ..datasets.bop_boxes import Boxes
    from ..estimation import PoseDetector
    from ..estimation.detection import SearchRegion
    from ..geometry.camera import Camera
    from ..geometry.mesh import Mesh, Unit


def run(args: argparse.Namespace) -> int:
    """Detect in image after image and write what was done, after Ctrl-C too."""
    from ..datasets.bop import TARGETS, BopDataset, write_results
    from ..estimation import PoseDetector, TemplateStore
    from ..estimation.detection import default_store

    _check_options(args)
    dataset = BopDataset(args.dataset, args.split, mesh_unit=_unit(args))
    name = TARGETS if args.targets is None else targets_file(args.targets)
    wanted = dataset.targets(name)
    boxes = _boxes(args, dataset, wanted)
    images: dict[tuple[int, int], list[BopTarget]] = {}
    for target in wanted:
        images.setdefault((target.scene, target.image), []).append(target)
    check_result(args, *([] if args.boxes is None else [Path(args.boxes)]))
    _check(dataset, images, args.distance)
    setting = Setting.of(args)
    policy, renderer = make_tools(setting)
    make = partial(
        PoseDetector,
        policy=policy,
        renderer=renderer,
        config=setting.config,
        store=TemplateStore(default_store()),
        threads=setting.threads,
    )
    done: list[Estimate] = []
    errors: list[str] = []
    facts = _facts(args, images, boxes, setting)
    with Journal(args.output, facts, args.resume) as journal:
        found = [[estimate_of(line) for line in entry] for entry in journal.entries]
        left = list(images.values())[len(found) :]
        done += (estimate for image in found for estimate in image)
        try:
            for targets in progress(left, len(left), "detect", "image"):
                try:
                    new = detect_image(dataset, targets, make, args.distance, boxes)
                except InputError as error:  # one that cannot be used does not stop the others
                    errors.append(f"image {targets[0].image} of scene {targets[0].scene}: {error}")
                    note(errors[-1])
                    new = []
                journal.add([estimate_line(estimate) for estimate in new])
                done += new
        finally:
            if done:
                write_results(args.output, done)
        journal.finish()
    if errors and len(errors) == len(images):
        raise InputError(f"no image could be used; the first says: {errors[0]}")
    print(f"{len(done)} poses in {len(images)} images: {args.output}")
    return 0


def _check_options(args: argparse.Namespace) -> None:
    """`InputError` for what is missing, and by name for what is for --image alone."""
    if args.split is None:
        raise InputError("--split missing: the folder of the data set, as test.")
    names = ("mesh", "image", "camera", "fov", "box", "mask", "points", "start")
    mixed = [f"--{name}" for name in names if getattr(args, name) is not None]
    mixed += ["--instances"] * (args.instances != 1)
    mixed += ["--allow_untextured"] * args.allow_untextured
    mixed += ["--method"] * (args.method != "templates")
    mixed += given_seed_options(args)
    if mixed:
        raise InputError(f"{', '.join(mixed)} is not for --dataset.")
    check_settings(args, TEMPLATES, "with --dataset")


def _unit(args: argparse.Namespace) -> Unit:
    """The unit of the models, BOP's where nothing is said."""
    unit: Unit = args.mesh_unit or "mm"
    return unit


def _facts(
    args: argparse.Namespace,
    images: dict[tuple[int, int], list[BopTarget]],
    boxes: Boxes | None,
    setting: Setting,
) -> dict[str, Any]:
    """What the poses depend on: a run with other facts cannot be gone on with."""
    targets = [list(map(asdict, some)) for some in images.values()]
    return {
        "dataset": str(args.dataset.resolve()),
        "split": args.split,
        "mesh_unit": _unit(args),
        "targets": _digest(targets),
        "distance": args.distance,
        "boxes": None if boxes is None else _digest(sorted(boxes.items())),
        **run_facts(setting),
    }


def _digest(content: Any) -> str:
    return hashlib.sha256(json.dumps(content).encode()).hexdigest()


def _boxes(
    args: argparse.Namespace, dataset: BopDataset, targets: Iterable[BopTarget]
) -> Boxes | None:
    """Where to look, as --boxes says; a note tells of what is too small to be looked into."""
    if args.boxes is None:
        return None
    from ..datasets.bop_boxes import TRUTH, read_boxes, true_boxes
    from ..estimation.detection.region import SMALLEST_BOX

    given = true_boxes(dataset, targets) if args.boxes == TRUTH else read_boxes(Path(args.boxes))
    large = {
        key: [box for box in some if min(box[2:]) >= SMALLEST_BOX] for key, some in given.items()
    }
    dropped = sum(map(len, given.values())) - sum(map(len, large.values()))
    if dropped:
        note(
            f"{dropped} of {sum(map(len, given.values()))} boxes are less than {SMALLEST_BOX} "
            "pixels wide or high; nothing is looked for there."
        )
    return large


def _check(
    dataset: BopDataset,
    images: dict[tuple[int, int], list[BopTarget]],
    distance: Sequence[float] | None,
) -> None:
    """Load every mesh, find every image and look at the distance before the long work."""
    from ..estimation.detection import SearchRegion

    for (scene, image), targets in images.items():
        dataset.check_image(scene, image)
        SearchRegion.checked(dataset.camera(scene, image, (1, 1)), distance=distance)
        for target in targets:
            if target.object is not None:
                dataset.mesh(target.object)


def detect_image(
    dataset: BopDataset,
    targets: Sequence[BopTarget],
    make: Callable[[Mesh, Camera], PoseDetector],
    distance: Sequence[float] | None = None,
    boxes: Boxes | None = None,
) -> list[Estimate]:
    """The poses of an image's targets, found or not: BOP counts recall and orders by score.

    `make` gives the detector of a mesh. A target without an object, as in BOP's detection tasks,
    stands for every object of the models. With `boxes` nothing is looked for outside of them. The
    score is the probability that the pose is right, of a target with an object given that it is in
    the image.
    """
    from ..datasets.bop import Estimate
    from ..estimation.detection import detect_objects
    from ..frame import prepare_frame

    scene, image = targets[0].scene, targets[0].image
    picture = dataset.image(scene, image)
    camera = dataset.camera(scene, image, (picture.shape[1], picture.shape[0]))
    frame = prepare_frame(picture, camera)
    searches = _searches(dataset, targets, camera, distance, boxes)
    detectors = {number: make(dataset.mesh(number), camera) for number, *_ in searches}
    for detector in detectors.values():
        detector.prepare()
    begin = time.perf_counter()
    detections = detect_objects(
        [detectors[number] for number, *_ in searches],
        frame,
        [count for _, count, _ in searches],
        [region for *_, region in searches],
    )
    seconds = time.perf_counter() - begin
    present = {target.object for target in targets}
    found = []
    for (number, count, _), detection in zip(searches, detections, strict=True):
        for one in (*detection.instances, *detection.rejected)[:count]:
            if number in present:
                one = one.known_present(detectors[number].config.verification)
            found.append(Estimate(scene, image, number, one.probability, one.pose, seconds))
    return found


def _searches(
    dataset: BopDataset,
    targets: Sequence[BopTarget],
    camera: Camera,
    distance: Sequence[float] | None,
    boxes: Boxes | None,
) -> list[tuple[int, int, SearchRegion]]:
    """What is looked for in an image: the object, how many of it at most, and where."""
    from ..estimation.detection import SearchRegion

    anywhere = SearchRegion.checked(camera, distance=distance)
    found: list[tuple[int, int, SearchRegion]] = []
    for target in targets:
        count = target.count or 1
        for number in dataset.objects() if target.object is None else [target.object]:
            if boxes is None:
                found.append((number, count, anywhere))
                continue
            for box in boxes.get((target.scene, target.image, number), [])[:count]:
                try:
                    region = replace(anywhere, box=SearchRegion.checked(camera, box).box)
                except InputError as error:
                    where = f"scene {target.scene}, image {target.image}, object {number}"
                    note(f"{where}: {error} Nothing is looked for there.")
                    continue
                found.append((number, 1, region))
    return found
