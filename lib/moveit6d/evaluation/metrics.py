"""Errors of poses and what is counted from them.

Pure functions on tensors; never reads files. Poses and points belong to the mesh file's frame.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ..errors import InputError
from ..geometry.pose import Pose

# A frame is right if its ADD is below this share of the object's diameter.
ADD_LIMIT = 0.10
# A track is lost where this many frames in a row are wrong.
LOST_RUN = 15


def add(estimate: Pose, truth: Pose, points: Tensor) -> Tensor:
    """ADD: mean distance between points (N, 3) under two poses (...), metres: (...)."""
    points = points.to(truth.translation)
    turn = estimate.rotation - truth.rotation
    shift = estimate.translation - truth.translation
    distance: Tensor = (points @ turn.mT + shift[..., None, :]).norm(dim=-1)
    return distance.mean(-1)


def adi(estimate: Pose, truth: Pose, points: Tensor) -> Tensor:
    """Mean distance from each true point to the nearest estimated one, metres: (...).

    For objects that look the same from several sides. The search goes from the truth to the
    estimate, as in BOP; the other way round gives slightly different numbers.
    """
    from scipy.spatial import cKDTree

    points = points.to(truth.translation)
    estimated = estimate.transform(points).reshape(-1, len(points), 3).numpy()
    true = truth.transform(points).reshape(-1, len(points), 3).numpy()
    means = [cKDTree(e).query(t)[0].mean() for t, e in zip(true, estimated, strict=True)]
    return torch.tensor(means, dtype=torch.float64).reshape(truth.batch_shape)


def add_s(estimate: Pose, truth: Pose, points: Tensor, symmetric: bool) -> Tensor:
    """ADD(-S): ADI for an object that is declared symmetric, ADD for any other, metres: (...)."""
    return adi(estimate, truth, points) if symmetric else add(estimate, truth, points)


def translation_error(estimate: Pose, truth: Pose) -> Tensor:
    """Distance of the two origins, metres: (...)."""
    distance: Tensor = (estimate.translation - truth.translation).norm(dim=-1)
    return distance


def rotation_error(estimate: Pose, truth: Pose) -> Tensor:
    """Angle between two rotations (...), degrees: (...). Exact also for tiny and for half turns."""
    turn = estimate.rotation.mT @ truth.rotation
    skew = torch.stack([
        turn[..., 2, 1] - turn[..., 1, 2],
        turn[..., 0, 2] - turn[..., 2, 0],
        turn[..., 1, 0] - turn[..., 0, 1],
    ], -1)  # fmt: skip
    trace = turn.diagonal(dim1=-2, dim2=-1).sum(-1)
    return torch.rad2deg(torch.atan2(skew.norm(dim=-1), trace - 1))


def accuracy(errors: Tensor, limit: float | Tensor) -> float:
    """Share of the errors (N,) strictly below the limit; an infinite error is never below."""
    if not len(errors):
        raise InputError("accuracy: there is no error to count.")
    return float((errors < limit).double().mean())


def frames_until_lost(errors: Tensor, limit: float, run: int = LOST_RUN) -> int:
    """Index + 1 of the first of the frames (N,) from which all of `run` frames are not below limit.

    Near the end the frames that are left are enough. N + 1 for a track that is never lost.
    """
    good = (errors < limit).tolist()
    for k in range(len(good)):
        if not any(good[k : k + run]):
            return k + 1
    return len(good) + 1


def auroc(scores: Tensor, correct: Tensor) -> float:
    """How well scores (N,) tell right (N,) from wrong: 1 perfectly, 0.5 not at all.

    The chance that a right one has a higher score than a wrong one, ties counting half; NaN if all
    are right or all are wrong.
    """
    right, wrong = scores[correct.bool()].double(), scores[~correct.bool()].double()
    if not len(right) or not len(wrong):
        return float("nan")
    ordered = wrong.sort().values
    below = torch.searchsorted(ordered, right)
    not_above = torch.searchsorted(ordered, right, right=True)
    return float((below + not_above).double().mean() / (2 * len(wrong)))
