"""`moveit6d refine`: better poses from the poses of a BOP result file.

Never detects: what the file does not list stays unlisted.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .common import add_tracking_options, add_verb, note, positive, progress, set_up

if TYPE_CHECKING:
    from ..datasets.bop import BopDataset, Estimate
    from ..estimation import Target, TrackingResult
    from ..policies import Policy
    from ..rendering.renderer import Renderer

DESCRIPTION = """\
Refines every pose of a BOP result file on the images of a data set in BOP's layout. Rows keep
their order. Intrinsics are those of each image (scene_camera.json), meshes those of models/
(millimetres, as BOP has them). Ground truth is not read.

files read:
  DATASET/models/obj_000001.ply and models_info.json
  DATASET/SPLIT/000002/scene_camera.json and rgb/000003.png (or .jpg, or gray/)
  --initial  scene_id,im_id,obj_id,score,R,t,time with R row-major, t in millimetres

file written:
  --output   the same format; score is the confidence in the refined pose, time the seconds
             spent on the whole image (reading it left out). A pose that cannot be refined
             (out of sight, damaged image) is written as it was given, with score 0
"""

EPILOG = """\
examples:
  moveit6d refine --dataset lmo --split test --initial poses.csv --output refined.csv
  moveit6d evaluate bop --dataset lmo --split test --results poses.csv refined.csv
"""


def add_parser(verbs: Any) -> None:
    """Add the verb."""
    parser = add_verb(
        verbs, "refine", "improve the poses of a BOP result file", DESCRIPTION, EPILOG
    )
    needed = parser.add_argument_group("needed")
    needed.add_argument("--dataset", type=Path, required=True, metavar="DIR", help="BOP data set")
    needed.add_argument("--split", required=True, metavar="NAME", help="folder in it, as test")
    needed.add_argument(
        "--initial", type=Path, required=True, metavar="FILE", help="poses to begin with"
    )
    needed.add_argument("--output", type=Path, required=True, metavar="FILE", help="refined poses")
    parser.add_argument(
        "--batch", type=positive, default=32, metavar="N", help="poses of an image at once at most"
    )
    add_tracking_options(parser)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Refine image by image and write what was done, after Ctrl-C too."""
    from ..datasets.bop import BopDataset, by_image, read_results, write_results

    dataset = BopDataset(args.dataset, args.split)
    initial = read_results(args.initial)
    check(dataset, initial, args.initial)
    policy, renderer = set_up(args)
    images = list(by_image(initial))
    done: dict[int, Estimate] = {}
    try:
        for (scene, image), rows in progress(images, len(images), "refine", "image"):
            given = [initial[row] for row in rows]
            try:
                refined = refine_image(dataset, given, policy, renderer, args)
            except InputError as error:
                note(f"image {image} of scene {scene}: {error}")
                refined = [replace(estimate, score=0.0, seconds=0.0) for estimate in given]
            done.update(zip(rows, refined, strict=True))
    finally:
        if done:
            write_results(args.output, [done[row] for row in sorted(done)])
    kept = sum(done[row].pose is initial[row].pose for row in done)
    print(f"{len(done)} poses in {len(images)} images, {kept} kept as given: {args.output}")
    return 0


def check(dataset: BopDataset, estimates: Sequence[Estimate], file: Path) -> None:
    """Load every mesh and find every image before the long work; errors name the row."""
    known: set[tuple[int, int]] = set()
    for number, estimate in enumerate(estimates, 1):
        try:
            dataset.mesh(estimate.object)
            if (estimate.scene, estimate.image) not in known:
                dataset.check_image(estimate.scene, estimate.image)
                known.add((estimate.scene, estimate.image))
        except InputError as error:
            raise InputError(f"{file}, row {number}: {error}") from error


def refine_image(
    dataset: BopDataset,
    estimates: Sequence[Estimate],
    policy: Policy,
    renderer: Renderer,
    args: argparse.Namespace,
) -> list[Estimate]:
    """Refine the poses in one image; all of them carry the seconds of the whole image."""
    from ..estimation import Target

    scene, image = estimates[0].scene, estimates[0].image
    picture = dataset.image(scene, image)
    camera = dataset.camera(scene, image, (picture.shape[1], picture.shape[0]))
    start = time.perf_counter()
    targets = [Target(picture, camera, dataset.mesh(e.object), e.pose) for e in estimates]
    results: list[TrackingResult] = []
    for first in range(0, len(targets), args.batch):
        results += _refine(targets[first : first + args.batch], policy, renderer, args.max_steps)
    seconds = time.perf_counter() - start
    refined = []
    for estimate, result in zip(estimates, results, strict=True):
        if result.pose is None:
            note(f"scene {scene}, image {image}, object {estimate.object}: {result.error}")
            refined.append(replace(estimate, score=0.0, seconds=seconds))
        else:
            refined.append(
                replace(estimate, pose=result.pose, score=result.confidence, seconds=seconds)
            )
    return refined


def _refine(
    targets: list[Target], policy: Policy, renderer: Renderer, max_steps: int | None
) -> list[TrackingResult]:
    """The loop's results; one start pose out of sight fails alone, not the whole batch."""
    from ..estimation import StopReason, TrackingResult, refine_batch

    try:
        return refine_batch(targets, policy=policy, renderer=renderer, max_steps=max_steps)
    except InputError as error:
        if len(targets) == 1:
            return [TrackingResult(None, 0, StopReason.FAILED, 0.0, 0.0, str(error))]
        return [
            result
            for target in targets
            for result in _refine([target], policy, renderer, max_steps)
        ]
