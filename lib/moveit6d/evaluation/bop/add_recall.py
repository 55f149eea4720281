"""Scores BOP result files by ADD(-S): the share of right poses before and after a refinement.

Never refines. Every true pose counts: one that no estimate of a file is for is wrong there.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from math import isnan

import numpy as np
import torch
from torch import Tensor

from ...datasets.bop import BopDataset, Estimate
from ...errors import InputError
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from .. import metrics
from ..metrics.calibration import Reliability, reliability
from ..tables import markdown, percent
from .matching import best_scored, match

MODEL_POINTS = 3000
Target = tuple[int, int, int]  # scene, image, object


@dataclass(frozen=True)
class ResultScore:
    """Figures of one result file. Errors are ADD(-S) in diameters, infinite where nothing is given.

    `errors`, `scores` and `objects` (N,) run over the true poses of the targets in their order.
    """

    errors: Tensor
    scores: Tensor
    objects: Tensor

    def below(self, limit: float, object: int | None = None) -> float:
        """Share of targets, of one object or of all, with an error strictly below the limit."""
        chosen = self.errors if object is None else self.errors[self.objects == object]
        return metrics.accuracy(chosen, limit)

    @property
    def median(self) -> float:
        """Median error in diameters."""
        return float(np.median(self.errors.numpy()))

    @property
    def auroc(self) -> float:
        """How well the score column tells poses below 10 % from others."""
        return metrics.auroc(self.scores, self.errors < metrics.ADD_LIMIT)

    @property
    def reliability(self) -> Reliability:
        """How good the score column is as a probability, where there is an estimate."""
        given = self.errors.isfinite()
        return reliability(self.scores[given], self.errors[given] < metrics.ADD_LIMIT)


def targets_of(estimates: Iterable[Estimate], dataset: BopDataset) -> list[Target]:
    """The targets that a result file lists and that the ground truth knows, in order."""
    listed = dict.fromkeys((e.scene, e.image, e.object) for e in estimates)
    found = [target for target in listed if _true_poses(dataset, target)]
    if not found:
        raise InputError("none of the estimates' objects is in the ground truth of this split.")
    return found


def score_results(
    dataset: BopDataset, estimates: Sequence[Estimate], targets: Sequence[Target]
) -> ResultScore:
    """Errors of the estimates of every target, one a true pose.

    Where an object occurs several times in an image, as many estimates count as there are true
    poses, best score first, and each takes the nearest true pose that is still free.
    """
    listed: dict[Target, list[Estimate]] = {}
    for estimate in estimates:
        key = (estimate.scene, estimate.image, estimate.object)
        listed.setdefault(key, []).append(estimate)
    found = [
        (error, score, target[2])
        for target in targets
        for error, score in _errors(dataset, target, listed.get(target, []))
    ]
    errors, scores, objects = zip(*found, strict=True)
    return ResultScore(
        torch.tensor(errors, dtype=torch.float64),
        torch.tensor(scores, dtype=torch.float64),
        torch.tensor(objects),
    )


def results_table(scores: Sequence[tuple[str, ResultScore]]) -> str:
    """Markdown table: one row a result file, with the share below 10 % d of every object."""
    objects = sorted({int(number) for _, score in scores for number in score.objects})
    head = ["file", "targets", "ADD(-S)<10%d", "ADD(-S)<5%d", "median %d", "score AUROC"]
    head += [f"obj {number}" for number in objects]
    rows = []
    for name, score in scores:
        cells = [
            name,
            str(len(score.errors)),
            percent(score.below(0.1)),
            percent(score.below(0.05)),
        ]
        cells += [f"{100 * score.median:.1f}", "-" if isnan(score.auroc) else f"{score.auroc:.3f}"]
        rows.append(cells + [percent(score.below(0.1, number)) for number in objects])
    return markdown(head, rows)


@lru_cache(maxsize=64)
def _points(mesh: Mesh) -> Tensor:
    """Up to 3000 vertices (N, 3), drawn with a fixed seed, in the file's frame, metres."""
    vertices = mesh.vertices.astype(np.float64) + mesh.center
    count = min(MODEL_POINTS, len(vertices))
    return torch.from_numpy(vertices[np.random.default_rng(0).choice(len(vertices), count, False)])


def _true_poses(dataset: BopDataset, target: Target) -> list[Pose]:
    scene, image, number = target
    return [one.pose for one in dataset.truth(scene, image) if one.object == number]


def _errors(
    dataset: BopDataset, target: Target, estimates: Sequence[Estimate]
) -> list[tuple[float, float]]:
    """Error in diameters and score for each true pose of a target; infinite, 0 if none is left."""
    truth, number = _true_poses(dataset, target), target[2]
    found = [(float("inf"), 0.0)] * len(truth)
    if not estimates:
        return found
    points, symmetric = _points(dataset.mesh(number)), dataset.is_symmetric(number)
    diameter = dataset.diameter(number)
    order = best_scored([estimate.score for estimate in estimates], len(truth))
    table = torch.tensor(
        [
            [float(metrics.add_s(estimates[k].pose, pose, points, symmetric)) for pose in truth]
            for k in order
        ],
        dtype=torch.float64,
    )
    for k, row, taken in zip(order, table, match(table, float("inf")), strict=True):
        if taken is not None:
            found[taken] = (float(row[taken]) / diameter, estimates[k].score)
    return found
