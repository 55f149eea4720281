"""`moveit6d refine`: better poses from the poses of a BOP result file.

Never adds a row: what the file does not list stays unlisted.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from ..io import file_digest
from .apart import check_result
from .common import (
    UNITS,
    Setting,
    add_jobs_options,
    add_tracking_options,
    add_verb,
    make_tools,
    positive,
    run_facts,
    tools,
)
from .journal import Journal, estimate_line, estimate_of
from .messages import note, progress
from .settings import SettingsPart

if TYPE_CHECKING:
    from ..datasets.bop import BopDataset, Estimate
    from ..estimation import TemplateStore, TrackingResult
    from ..geometry.mesh import Unit
    from ..policies import Policy
    from ..rendering.renderer import Renderer

# The settings that decide about single images, lost objects among them.
READ = SettingsPart(
    ("loop", "multi_start", "single_image", "contour", "detection", "recovery.enabled"),
    but=(
        "loop.displacement_error",  # of a number that is not written
        "multi_start.recovery",
        "multi_start.recovery_first",
        "multi_start.recovery_every",
        "multi_start.race",
        "multi_start.duplicate_delta",
        "contour.histogram_rate",
        "detection.region",
        "detection.least_distance",
    ),
)

DESCRIPTION = """\
Refines every pose of a BOP result file on the images of a data set in BOP's layout. Rows keep
their order. Intrinsics are those of each image (scene_camera.json), meshes those of models/
(millimetres, as BOP has them). Ground truth is not read.

files read:
  DATASET/models/obj_000001.ply and models_info.json
  DATASET/SPLIT/000002/scene_camera.json and rgb/000003.png (or .jpg, or gray/)
  --initial  scene_id,im_id,obj_id,score,R,t,time with R row-major, t in millimetres

file written:
  --output   (beside it OUTPUT.unfinished until all is done, which --resume goes on with)
             the same format; score is how likely the pose is within a tenth of the diameter
             (the confidence, times what the object's size in the image allows to know), time
             the seconds spent on the whole image (reading it left out). If no row of an object
             can be refined in an image (behind the camera, out of sight, far too near), the
             object is looked for in all of it, as `moveit6d detect` does; score is then how
             likely what was found is right. --no_recovery: it is not. A pose that still cannot
             be refined (damaged image) is written as it was given, with score 0

With --jobs N images are shared among N processes; with --ray among the machines of a cluster
(needs moveit6d[ray], and the data set under the same path everywhere). The poses are the same.
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
    parser.add_argument("--mesh_unit", choices=UNITS, default="mm", help="unit of the models")
    parser.add_argument(
        "--batch", type=positive, default=32, metavar="N", help="poses of an image at once at most"
    )
    parser.add_argument(
        "--resume", action="store_true", help="go on with a run that was interrupted"
    )
    add_jobs_options(parser)
    add_tracking_options(parser, part=READ)
    parser.set_defaults(run=run)


def run(args: argparse.Namespace) -> int:
    """Refine image by image and write what was done, after Ctrl-C too."""
    from ..datasets.bop import BopDataset, by_image, read_results, write_results
    from ..parallel import run_jobs

    check_result(args)
    dataset = BopDataset(args.dataset, args.split, mesh_unit=args.mesh_unit)
    initial = read_results(args.initial)
    check(dataset, initial, args.initial)
    setting = Setting.of(args)
    policy, renderer = make_tools(setting)
    images = list(by_image(initial))
    jobs = [
        ImageJob(
            args.dataset.resolve(),
            args.split,
            tuple(initial[row] for row in rows),
            setting,
            args.batch,
            args.mesh_unit,
        )
        for _, rows in images
    ]

    def here(job: ImageJob) -> list[Estimate]:
        return refine_image(dataset, job, policy, renderer)

    alone = args.jobs == 1 and args.ray is None
    done: dict[int, Estimate] = {}
    with Journal(args.output, _facts(args, setting), args.resume) as journal:
        for line in journal.entries:
            done[line["row"]] = estimate_of(line)
        left = [k for k, (_, rows) in enumerate(images) if any(row not in done for row in rows)]
        outcomes = run_jobs(
            here if alone else work,
            [jobs[k] for k in left],
            jobs=args.jobs,
            ray=args.ray,
            cpus=args.threads,
        )
        try:
            for job_result in progress(outcomes, len(left), "refine", "image"):
                (scene, image), rows = images[left[job_result.index]]
                refined = job_result.result
                if refined is None:
                    note(f"image {image} of scene {scene}: {job_result.error}")
                    refined = [replace(initial[row], score=0.0, seconds=0.0) for row in rows]
                for row, estimate in zip(rows, refined, strict=True):
                    done[row] = estimate
                    journal.add({"row": row, **estimate_line(estimate)})
        finally:
            if done:
                write_results(args.output, [done[row] for row in sorted(done)])
        journal.finish()
    kept = sum(_same(done[row], initial[row]) for row in done)
    print(f"{len(done)} poses in {len(images)} images, {kept} kept as given: {args.output}")
    return 0


def _facts(args: argparse.Namespace, setting: Setting) -> dict[str, Any]:
    """What the poses depend on: a run with other facts cannot be gone on with."""
    return {
        "dataset": str(args.dataset.resolve()),
        "split": args.split,
        "mesh_unit": args.mesh_unit,
        "initial": file_digest(args.initial),
        **run_facts(setting),
    }


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


@dataclass(frozen=True)
class ImageJob:
    """The poses in one image and all that decides about them; can be sent to another process."""

    root: Path
    split: str
    estimates: tuple[Estimate, ...]
    setting: Setting
    batch: int
    mesh_unit: Unit = "mm"


def work(job: ImageJob) -> list[Estimate]:
    """Do the job in a worker process, which keeps its network and meshes for the next one."""
    return refine_image(_dataset(job.root, job.split, job.mesh_unit), job, *tools(job.setting))


@lru_cache(maxsize=1)
def _dataset(root: Path, split: str, mesh_unit: Unit) -> BopDataset:
    from ..datasets.bop import BopDataset

    return BopDataset(root, split, mesh_unit=mesh_unit)


@lru_cache(maxsize=1)
def _store() -> TemplateStore:
    from ..estimation import TemplateStore
    from ..estimation.detection import default_store

    return TemplateStore(default_store())


def refine_image(
    dataset: BopDataset, job: ImageJob, policy: Policy, renderer: Renderer
) -> list[Estimate]:
    """Refine the poses in one image; all of them carry the seconds of the whole image."""
    from ..estimation import Target, refine_single, search_lost_targets
    from ..frame import prepare_frame

    estimates = job.estimates
    scene, image = estimates[0].scene, estimates[0].image
    picture = dataset.image(scene, image)
    camera = dataset.camera(scene, image, (picture.shape[1], picture.shape[0]))
    start = time.perf_counter()
    frame = prepare_frame(picture, camera)  # once, for the loop and for the contour refinement
    targets = [Target(frame, camera, dataset.mesh(e.object), e.pose) for e in estimates]
    results: list[TrackingResult] = []
    for first in range(0, len(targets), job.batch):
        some = targets[first : first + job.batch]
        results += refine_single(some, policy=policy, renderer=renderer, config=job.setting.config)
    found = search_lost_targets(
        targets,
        results,
        policy=policy,
        renderer=renderer,
        config=job.setting.config,
        store=_store(),
    )
    seconds = time.perf_counter() - start
    refined = []
    for row, (estimate, result) in enumerate(zip(estimates, results, strict=True)):
        if result.pose is None:
            searched = " It was looked for in the whole image." if row in found else ""
            where = f"scene {scene}, image {image}, object {estimate.object}"
            note(f"{where}: {result.error}{searched}")
        one = found.get(row, result)
        if one.pose is None:
            refined.append(replace(estimate, score=0.0, seconds=seconds))
        else:
            refined.append(replace(estimate, pose=one.pose, score=one.score, seconds=seconds))
    return refined


def _same(refined: Estimate, given: Estimate) -> bool:
    """Whether the pose was kept; one that a worker sent is another object with its numbers."""
    return refined.score == 0.0 and bool(
        (refined.pose.rotation == given.pose.rotation).all()
        and (refined.pose.translation == given.pose.translation).all()
    )
