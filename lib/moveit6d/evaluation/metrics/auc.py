"""Areas under the curve "share of errors below a threshold", from 0 to a cap, as shares of 1.

Never mixes the two forms that are published under one name: the VOC form of YCB-Video's toolbox,
which its tables need, and the exact integral, which is what the words say and what M3T reports.
"""

from __future__ import annotations

import torch
from torch import Tensor

from ...errors import InputError

CAP = 0.1  # metres
OPT_CAP = 0.2  # diameters


def exact_auc(errors: Tensor, cap: float = CAP) -> float:
    """Mean of max(0, 1 - error / cap) over errors (N,): the exact area, in [0, 1].

    A missing pose has an infinite error (NaN counts the same).

    Examples:
        >>> import torch
        >>> round(exact_auc(torch.tensor([0.0, 0.05, float("inf")])), 3)
        0.5
    """
    known = _checked(errors)
    return float((1 - known / cap).clamp_min(0).mean())


def voc_auc(errors: Tensor, cap: float = CAP) -> float:
    """The area as YCB-Video's toolbox has it, in [0, 1]: never below `exact_auc`.

    Over each step from one error (N,) to the next the share *after* the step counts, and the last
    share up to the cap; that is `exact_auc` plus the largest error not above the cap over cap · N.
    0 where nothing is below the cap, where the toolbox itself fails.
    (yuxng/YCB_Video_toolbox, plot_accuracy_keyframe.m.)

    Examples:
        >>> import torch
        >>> round(voc_auc(torch.tensor([0.0, 0.05, float("inf")])), 3)
        0.667
    """
    known = _checked(errors).sort().values
    kept = known[known <= cap]
    share = torch.arange(1, len(kept) + 1, dtype=torch.float64) / len(known)
    if not len(kept):
        return 0.0
    steps = torch.diff(kept, prepend=kept.new_zeros(1))
    return float((steps @ share + (cap - kept[-1]) * share[-1]) / cap)


def opt_score(add: Tensor, diameter: float) -> float:
    """Score of the OPT benchmark, 0 to 20, from ADD (N,) and the diameter in the same unit.

    The exact area up to 0.2 diameters, times 20. (DLR-RM/3DObjectTracking, opt_evaluator.cpp.)
    """
    return 100 * OPT_CAP * exact_auc(add / diameter, OPT_CAP)


def _checked(errors: Tensor) -> Tensor:
    """The errors as (N,) float64, NaN made infinite."""
    if errors.dim() != 1 or not len(errors):
        raise InputError(f"area under a curve: expected errors (N,), found {tuple(errors.shape)}.")
    if (errors < 0).any():
        raise InputError("area under a curve: an error is negative.")
    return errors.detach().to("cpu", torch.float64).nan_to_num(float("inf"), posinf=float("inf"))
