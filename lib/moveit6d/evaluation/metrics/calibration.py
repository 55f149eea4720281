"""Whether a confidence is a probability: bins of a reliability diagram, calibration error.

Never reads files and never draws.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ...errors import InputError
from .pose_errors import auroc

BINS = 10


@dataclass(frozen=True, eq=False)
class Reliability:
    """A confidence (N,) against what came out.

    `confidence`, `right` and `counts` (bins,) are each bin's mean confidence, share of right poses
    and number of poses; empty bins are left out. `auroc` as in `metrics.auroc`.
    """

    confidence: Tensor
    right: Tensor
    counts: Tensor
    auroc: float

    @property
    def calibration_error(self) -> float:
        """Expected calibration error (Naeini et al., AAAI 2015), in [0, 1]."""
        gaps = (self.confidence - self.right).abs()
        return float((gaps * self.counts).sum() / self.counts.sum())

    def line(self) -> str:
        """One sentence of figures."""
        area = "- (all right, or all wrong)" if math.isnan(self.auroc) else f"{self.auroc:.3f}"
        return (
            f"confidence of {int(self.counts.sum())} poses: AUROC {area} for ADD(-S) < 10 % d, "
            f"expected calibration error {self.calibration_error:.3f}"
        )


def reliability(confidence: Tensor, right: Tensor, bins: int = BINS) -> Reliability:
    """Bins of equal width over [0, 1] for confidences (N,) and whether each pose is right (N,).

    `InputError` for no poses and for confidences outside [0, 1].

    Examples:
        >>> import torch
        >>> found = reliability(torch.tensor([0.9, 0.9, 0.1]), torch.tensor([True, False, False]))
        >>> found.right.tolist(), round(found.calibration_error, 2)
        ([0.0, 0.5], 0.3)
    """
    confidence, right = confidence.double(), right.double()
    if not len(confidence):
        raise InputError("There is no pose with a confidence.")
    if not bool(((confidence >= 0) & (confidence <= 1)).all()):
        raise InputError("A confidence that is to be a probability must lie in [0, 1].")
    place = (confidence * bins).long().clamp_max(bins - 1)
    counts = torch.bincount(place, minlength=bins)
    filled = counts > 0

    def mean(values: Tensor) -> Tensor:
        return torch.bincount(place, values, bins)[filled] / counts[filled]

    return Reliability(mean(confidence), mean(right), counts[filled], auroc(confidence, right))
