"""Which estimates count as which true poses, and how many are right: BOP's rules of 2019.

Never computes an error of a pose and never reads files.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import Tensor

# Limits of MSSD and of VSD's share of wrong pixels; VSD's distances in diameters are the same ten.
SHARES = tuple(k / 100 for k in range(5, 51, 5))
# Limits of MSPD in pixels of an image 640 wide.
PIXELS = tuple(float(k) for k in range(5, 51, 5))


def match(errors: Tensor, limit: float) -> list[int | None]:
    """For each estimate, best score first, the true pose that it takes; errors are (E, G).

    Each takes the free one of least error, if that is strictly below the limit; a true pose is
    taken once. (bop_toolkit, pose_matching.match_poses.)

    Examples:
        >>> import torch
        >>> match(torch.tensor([[0.2, 0.1], [0.1, 0.3]]), limit=0.5)
        [1, 0]
    """
    free = torch.ones(errors.shape[1], dtype=torch.bool)
    taken: list[int | None] = []
    for row in errors:
        open_to = torch.where(free, row, torch.full_like(row, float("inf")))
        best = int(open_to.argmin()) if len(row) else -1
        if best >= 0 and float(open_to[best]) < limit:
            free[best] = False
            taken.append(best)
        else:
            taken.append(None)
    return taken


def matched_counts(errors: Tensor, limits: Sequence[float]) -> Tensor:
    """How many true poses are found, (K, L), from errors (E, G, K) or, for K = 1, (E, G)."""
    kinds = errors[..., None] if errors.dim() == 2 else errors
    counts = torch.zeros(kinds.shape[-1], len(limits), dtype=torch.int64)
    if not kinds.numel():
        return counts
    if kinds.shape[:2] == (1, 1):  # nearly always, and much faster
        return (kinds[0, 0][:, None] < kinds.new_tensor(limits)).long()
    for k in range(kinds.shape[-1]):
        for j, limit in enumerate(limits):
            counts[k, j] = sum(found is not None for found in match(kinds[..., k], limit))
    return counts


def most_visible(visible: Sequence[float], count: int) -> list[int]:
    """Indices of the `count` most visible true poses, the first of equals first: those that count.

    (bop_toolkit, eval_calc_scores.py with visib_gt_min = -1.)
    """
    return sorted(range(len(visible)), key=lambda k: visible[k], reverse=True)[:count]


def best_scored(scores: Sequence[float], count: int) -> list[int]:
    """Indices of the `count` estimates of highest score, best first, the first of equals first."""
    return sorted(range(len(scores)), key=lambda k: scores[k], reverse=True)[:count]
