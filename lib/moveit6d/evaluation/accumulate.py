"""torchmetrics classes that gather errors of poses batch by batch, on one process or several.

Never defines an error: each class takes one of the functions of `metrics` and counts what comes
out. An estimate with a number that is not finite is a miss: infinitely wrong, and counted.

    recall = Accuracy(metrics.add)
    recall.update(estimate, truth, points, diameter=0.184)
    recall.compute()
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Literal

import torch
from torch import Tensor
from torchmetrics import Metric
from torchmetrics.utilities import dim_zero_cat

from ..errors import InputError
from ..geometry.pose import Pose
from . import auc, bop_matching, metrics


class _Gathered(Metric):
    """Keeps every error."""

    full_state_update = False
    errors: list[Tensor]

    def __init__(self, error: metrics.ErrorFunction, **options: Any) -> None:
        super().__init__(**options)
        self.error = error
        self.add_state("errors", default=[], dist_reduce_fx="cat")

    def update(self, estimate: Pose, truth: Pose, *what: Any) -> None:
        """Take in poses (...); `what` is what the error function needs besides (points, …)."""
        self.errors.append(metrics.errors_of(self.error, estimate, truth, *what).to(self.device))

    def gathered(self) -> Tensor:
        """Every error so far (N,)."""
        if not self.errors:
            raise InputError(f"{type(self).__name__}: no pose has been given yet.")
        found: Tensor = dim_zero_cat(self.errors)
        return found


class MeanError(_Gathered):
    """Mean of any error of `metrics`, each cut at `cut` so that one miss does not hide the rest.

    With the usual `cut`, infinity, one miss makes the mean infinite.
    """

    higher_is_better = False

    def __init__(
        self, error: metrics.ErrorFunction, cut: float = float("inf"), **options: Any
    ) -> None:
        super().__init__(error, **options)
        self.cut = cut

    def compute(self) -> Tensor:
        """The mean, in the unit of the error."""
        return self.gathered().clamp_max(self.cut).mean()


class MedianError(_Gathered):
    """Median of any error of `metrics`; the mean of the middle two for an even number."""

    higher_is_better = False

    def compute(self) -> Tensor:
        """The median, in the unit of the error."""
        ordered = self.gathered().sort().values
        return (ordered[(len(ordered) - 1) // 2] + ordered[len(ordered) // 2]) / 2


class AreaUnderCurve(_Gathered):
    """Area under accuracy against threshold, from 0 to `cap`: see `auc` for the two forms."""

    higher_is_better = True

    def __init__(
        self,
        error: metrics.ErrorFunction,
        form: Literal["exact", "voc"],
        cap: float = auc.CAP,
        **options: Any,
    ) -> None:
        super().__init__(error, **options)
        if form not in ("exact", "voc"):
            raise InputError(f"AreaUnderCurve: the form must be exact or voc, found {form!r}.")
        self.form, self.cap = form, cap

    def compute(self) -> Tensor:
        """The area in [0, 1]."""
        area = auc.exact_auc if self.form == "exact" else auc.voc_auc
        return torch.tensor(area(self.gathered(), self.cap), dtype=torch.float64)


class FramesUntilLost(_Gathered):
    """First frame from which a track is lost; one metric a sequence, frames in order."""

    higher_is_better = True

    def __init__(
        self,
        error: metrics.ErrorFunction,
        limit: float,
        run: int = metrics.LOST_RUN,
        **options: Any,
    ) -> None:
        super().__init__(error, **options)
        self.limit, self.run = limit, run

    def compute(self) -> Tensor:
        """Frames, one more than there are for a track that is never lost."""
        return torch.tensor(metrics.frames_until_lost(self.gathered(), self.limit, self.run))


class _Share(Metric):
    """Counts what is right and what there is."""

    full_state_update = False
    higher_is_better = True
    right: Tensor
    total: Tensor

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.add_state("right", default=torch.tensor(0), dist_reduce_fx="sum")
        self.add_state("total", default=torch.tensor(0), dist_reduce_fx="sum")

    def _count(self, right: Tensor) -> None:
        self.right += right.sum().to(self.device)
        self.total += right.numel()

    def compute(self) -> Tensor:
        """The share in [0, 1]."""
        if not self.total:
            raise InputError(f"{type(self).__name__}: no pose has been given yet.")
        return self.right.double() / self.total


class Accuracy(_Share):
    """Share of poses whose error is strictly below `share` of the object's diameter."""

    def __init__(
        self, error: metrics.ErrorFunction, share: float = metrics.ADD_LIMIT, **options: Any
    ) -> None:
        super().__init__(**options)
        self.error, self.share = error, share

    def update(self, estimate: Pose, truth: Pose, *what: Any, diameter: float) -> None:
        """Take in poses (...) of one object with its diameter, in the unit of the error."""
        errors = metrics.errors_of(self.error, estimate, truth, *what)
        self._count(errors < self.share * diameter)


class WithinLimits(_Share):
    """Share of poses within 5 cm and 5° (or other limits); see `metrics.within`."""

    def __init__(
        self, metres: float = 0.05, degrees: float = 5.0, strict: bool = False, **options: Any
    ) -> None:
        super().__init__(**options)
        self.limits = (metres, degrees, strict)

    def update(self, estimate: Pose, truth: Pose) -> None:
        """Take in poses (...); comparisons with numbers that are not finite are false: a miss."""
        self._count(metrics.within(estimate, truth, *self.limits))


class Stability(Metric):
    """Mean motion from frame to frame, metres and degrees; one metric a sequence."""

    full_state_update = False
    rotations: list[Tensor]
    translations: list[Tensor]

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.add_state("rotations", default=[], dist_reduce_fx="cat")
        self.add_state("translations", default=[], dist_reduce_fx="cat")

    def update(self, poses: Pose) -> None:
        """Take in the next frames' poses (...), in order."""
        flat = metrics.flattened(poses)
        self.rotations.append(flat.rotation)
        self.translations.append(flat.translation)

    def compute(self) -> tuple[Tensor, Tensor]:
        """Mean translation (metres) and mean angle (degrees) between neighbours."""
        poses = Pose(dim_zero_cat(self.rotations), dim_zero_cat(self.translations))
        if len(poses) < 2:
            raise InputError("Stability: at least two poses are needed.")
        shift, turn = metrics.stability(poses)
        return shift.mean(), turn.mean()


class Failures(Metric):
    """How often a track was lost by Laval's rule; one metric a sequence, frames in order."""

    full_state_update = False
    higher_is_better = False
    shifts: list[Tensor]
    turns: list[Tensor]

    def __init__(self, **options: Any) -> None:
        super().__init__(**options)
        self.add_state("shifts", default=[], dist_reduce_fx="cat")
        self.add_state("turns", default=[], dist_reduce_fx="cat")

    def update(self, estimate: Pose, truth: Pose) -> None:
        """Take in the next frames' poses (...), in order."""
        self.shifts.append(metrics.errors_of(metrics.translation_error, estimate, truth))
        self.turns.append(metrics.errors_of(metrics.laval_rotation_error, estimate, truth))

    def compute(self) -> Tensor:
        """The number of failures."""
        if not self.shifts:
            return torch.tensor(0)
        return torch.tensor(
            metrics.laval_failures(dim_zero_cat(self.shifts), dim_zero_cat(self.turns))
        )


class AverageRecall(Metric):
    """BOP's average recall of one error over its limits, pooled over everything given."""

    full_state_update = False
    higher_is_better = True
    matched: Tensor
    total: Tensor

    def __init__(self, limits: Sequence[float], kinds: int = 1, **options: Any) -> None:
        super().__init__(**options)
        self.limits = tuple(limits)
        start = torch.zeros(kinds, len(self.limits), dtype=torch.int64)
        self.add_state("matched", default=start, dist_reduce_fx="sum")
        self.add_state("total", default=torch.tensor(0), dist_reduce_fx="sum")

    def update(self, errors: Tensor) -> None:
        """Take in one object of one image.

        `errors` (E, G) or, for VSD, (E, G, kinds): of its estimates, best score first, against its
        true poses that count. Without any estimate E is 0 and G still counts.
        """
        counts = bop_matching.matched_counts(errors, self.limits)
        self.matched += counts.to(self.matched)
        self.total += errors.shape[1]

    def compute(self) -> Tensor:
        """The mean over all limits (and kinds) of the share of true poses that were matched."""
        if not self.total:
            raise InputError("AverageRecall: there is no true pose to be found.")
        return (self.matched.double() / self.total).mean()
