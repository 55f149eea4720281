"""The BOP challenge's score since 2019: average recall of VSD, MSSD and MSPD over ten limits each.

Never refines, and never needs depth: without it VSD is left out, and with it the overall score.
(bop_toolkit, scripts/eval_bop19_pose.py.)
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from itertools import product

import torch
from torch import Tensor

from ...checks import entry, whole
from ...datasets.bop import TARGETS, BopDataset, BopTarget, Estimate, Instance
from ...datasets.bop_layout import TESTED
from ...datasets.video import image_size
from ...errors import InputError
from ...geometry.camera import Camera
from ...geometry.hull import convex_hull
from ...geometry.mesh import Mesh
from ...io import read_json
from ...rendering.renderer import Renderer
from .. import metrics
from ..metrics.vsd import DELTA, DELTAS, distance_image, render_distances, vsd, window_of
from ..tables import markdown, percent
from .matching import PIXELS, SHARES, best_scored, matched_counts, most_visible

WIDTH = 640  # MSPD's limits are pixels of an image this wide
LEAST_VISIBLE = 0.1
KINDS = {"vsd": len(SHARES), "mssd": 1, "mspd": 1}


@dataclass
class Recalls:
    """How many of the instances were found, for each error and limit; of an object or of all."""

    instances: int = 0
    found: dict[str, Tensor] = field(
        default_factory=lambda: {
            kind: torch.zeros(count, len(SHARES), dtype=torch.int64)
            for kind, count in KINDS.items()
        }
    )

    def add(self, counts: Mapping[str, Tensor], instances: int) -> None:
        """Take in one target."""
        self.instances += instances
        for kind, count in counts.items():
            self.found[kind] += count

    def average(self, kind: str) -> float:
        """Average recall of one error: the mean of 10 recalls, of 100 for VSD; 0 of nothing."""
        if not self.instances:
            return 0.0
        return float(self.found[kind].double().mean()) / self.instances


@dataclass(frozen=True)
class Bop19Score:
    """Average recalls of one result file, shares of 1.

    `depth` tells whether VSD could be measured; `seconds` is the mean time of an image, None if the
    file does not say it of every image.
    """

    all: Recalls
    objects: Mapping[int, Recalls]
    depth: bool
    seconds: float | None

    def recall(self, object: int | None = None) -> float | None:
        """AR: the mean of the three average recalls, None without depth."""
        known = self.all if object is None else self.objects[object]
        return sum(known.average(kind) for kind in KINDS) / len(KINDS) if self.depth else None


def targets_of(dataset: BopDataset, name: str | None = None) -> list[BopTarget]:
    """What is to be found: the named file, else `test_targets_bop19.json`, else what is visible.

    The file is that of the test splits. Without one these are all instances of which at least 10 %
    can be seen, as in bop_toolkit's enumerate_test_targets.py. `InputError` for detection targets,
    which name no objects.
    """
    known = dataset.split.startswith(TESTED) and (dataset.root / TARGETS).is_file()
    if name is None and not known:
        return [target for scene in dataset.scenes() for target in _visible_in(dataset, scene)]
    targets = dataset.targets(TARGETS if name is None else name)
    if any(target.object is None or target.count is None for target in targets):
        raise InputError(
            f"{dataset.root / (name or TARGETS)} holds targets of a detection task (no obj_id and "
            "inst_count); average recall needs those of the localisation task."
        )
    return targets


def has_depth(dataset: BopDataset, targets: Sequence[BopTarget]) -> bool:
    """Whether there is a depth image for the first of the targets."""
    return bool(targets) and dataset.depth(targets[0].scene, targets[0].image) is not None


def score_bop19(
    dataset: BopDataset,
    estimates: Iterable[Estimate],
    targets: Sequence[BopTarget],
    renderer: Renderer | None = None,
    progress: Callable[[], object] = lambda: None,
) -> Bop19Score:
    """Average recalls over all targets pooled; VSD only with a renderer (and depth images).

    Of each target the `count` best-scored estimates are matched with the `count` most visible true
    poses, at each limit anew. `progress` is called after each target.
    """
    if not targets:
        raise InputError(f"{dataset.root}: there is no target in this split.")
    rows: dict[tuple[int, int, int], list[Estimate]] = {}
    seconds: dict[tuple[int, int], float] = {}
    for one in estimates:
        rows.setdefault((one.scene, one.image, one.object), []).append(one)
        seconds[one.scene, one.image] = one.seconds
    if not any((one.scene, one.image, one.object) in rows for one in targets):
        raise InputError(f"{dataset.root}: none of the estimates is of a target of this split.")
    known = all(value >= 0 for value in seconds.values()) and bool(seconds)
    everything, objects = Recalls(), dict[int, Recalls]()
    at, view = None, None
    for target in targets:
        assert target.object is not None
        if view is None or at != (target.scene, target.image):  # targets come image by image
            at = (target.scene, target.image)
            view = _view(dataset, target, with_depth=renderer is not None)
        mine = rows.get((target.scene, target.image, target.object), [])
        best = [mine[k] for k in best_scored([one.score for one in mine], target.count or 0)]
        counts, instances = _count(dataset, target, best, view, renderer)
        for recalls in (everything, objects.setdefault(target.object, Recalls())):
            recalls.add(counts, instances)
        progress()
    mean = sum(seconds.values()) / len(seconds) if known else None
    return Bop19Score(everything, dict(sorted(objects.items())), renderer is not None, mean)


def bop19_table(scores: Sequence[tuple[str, Bop19Score]]) -> str:
    """Markdown table: one row a result file; objects by AR, or without depth by MSSD's recall."""
    numbers = sorted({number for _, score in scores for number in score.objects})
    depth = all(score.depth for _, score in scores)
    head = ["file", "instances", "AR", "AR VSD", "AR MSSD", "AR MSPD", "s/image"]
    head += [f"obj {number} {'AR' if depth else 'MSSD'}" for number in numbers]
    rows = []
    for name, score in scores:
        total = score.recall()
        cells = [name, str(score.all.instances), "-" if total is None else percent(total)]
        cells.append(percent(score.all.average("vsd")) if score.depth else "-")
        cells += [percent(score.all.average(kind)) for kind in ("mssd", "mspd")]
        cells.append("-" if score.seconds is None else f"{score.seconds:.3f}")
        for number in numbers:
            one = score.objects[number]
            whole = score.recall(number) if depth else one.average("mssd")
            cells.append("-" if whole is None else percent(whole))
        rows.append(cells)
    return markdown(head, rows)


@dataclass(frozen=True)
class _View:
    """What is known of an image: camera, true poses, and the distances that were measured in it."""

    camera: Camera
    truth: Sequence[Instance]
    seen: Tensor | None


def _count(
    dataset: BopDataset,
    target: BopTarget,
    found: Sequence[Estimate],
    view: _View,
    renderer: Renderer | None,
) -> tuple[dict[str, Tensor], int]:
    """How many instances of a target are found, by error and limit, and how many there are."""
    number, count = target.object or 0, target.count or 0
    there = [one for one in view.truth if one.object == number]
    true = [there[k].pose for k in most_visible([one.visible_fraction for one in there], count)]
    if not found or not true:
        return {}, len(true)
    mesh, diameter = dataset.eval_mesh(number), dataset.diameter(number)
    points, hull, symmetries = _shape(mesh)
    matrix, scale = view.camera.matrix, WIDTH / view.camera.width
    surface = torch.full((len(found), len(true)), float("inf"), dtype=torch.float64)
    pixels = surface.clone()
    for (e, one), (g, pose) in product(enumerate(found), enumerate(true)):
        if float(metrics.translation_error(one.pose, pose)) < diameter:  # as in BOP, else infinite
            surface[e, g] = metrics.mssd(one.pose, pose, hull, symmetries) / diameter
        pixels[e, g] = scale * metrics.mspd(one.pose, pose, points, symmetries, matrix)
    counts = {"mssd": matched_counts(surface, SHARES), "mspd": matched_counts(pixels, PIXELS)}
    if renderer is not None and view.seen is not None:
        delta = DELTAS.get(dataset.root.resolve().name, DELTA)
        errors = torch.empty(len(found), len(true), KINDS["vsd"], dtype=torch.float64)
        for (e, one), (g, pose) in product(enumerate(found), enumerate(true)):
            x0, y0, x1, y1 = window = window_of([one.pose, pose], mesh, view.camera)
            poses = [one.pose, pose]
            drawn, truth = render_distances(mesh, poses, view.camera, window, renderer)
            errors[e, g] = vsd(drawn, truth, view.seen[y0:y1, x0:x1], diameter, delta)
        counts["vsd"] = matched_counts(errors, SHARES)
    return counts, len(true)


def _visible_in(dataset: BopDataset, scene: int) -> Iterable[BopTarget]:
    for image in dataset.images(scene):
        counts: dict[int, int] = {}
        for one in dataset.truth(scene, image):
            if one.visible_fraction >= LEAST_VISIBLE:
                counts[one.object] = counts.get(one.object, 0) + 1
        yield from (BopTarget(scene, image, number, counts[number]) for number in sorted(counts))


@lru_cache(maxsize=64)
def _shape(mesh: Mesh) -> tuple[Tensor, Tensor, Tensor]:
    """Vertices, those that MSSD can depend on (its maximum lies on the hull), and symmetries."""
    points = mesh.vertices.astype("float64") + mesh.center
    motions = mesh.symmetries.transforms()
    return (
        torch.from_numpy(points),
        torch.from_numpy(convex_hull(points)),
        torch.from_numpy(motions),
    )


def _view(dataset: BopDataset, target: BopTarget, with_depth: bool) -> _View:
    """What is known of the target's image; measured distances only if wanted."""
    scene, image = target.scene, target.image
    camera = dataset.camera(scene, image, _size(dataset, scene, image))
    truth = dataset.truth(scene, image)
    if not with_depth:
        return _View(camera, truth, None)
    depth = dataset.depth(scene, image)
    if depth is None:
        raise InputError(f"image {image} of scene {scene} has no depth image, which VSD needs.")
    if depth.shape != (camera.height, camera.width):
        raise InputError(
            f"image {image} of scene {scene}: the depth image is {depth.shape[1]}×{depth.shape[0]}"
            f", the image {camera.width}×{camera.height}."
        )
    return _View(camera, truth, distance_image(torch.from_numpy(depth), camera))


def _size(dataset: BopDataset, scene: int, image: int) -> tuple[int, int]:
    """Width and height of an image; without its file those of the set's camera.json."""
    try:
        path = dataset.image_path(scene, image)
    except InputError:
        file = dataset.root / "camera.json"
        if not file.is_file():
            raise
        known = read_json(file)
        width, height = (entry(known, key, str(file)) for key in ("width", "height"))
        return whole(width, f"{file}: width"), whole(height, f"{file}: height")
    return image_size(path)
