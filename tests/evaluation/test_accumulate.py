"""Metrics that accumulate agree with the functions on everything at once; misses are counted."""

from __future__ import annotations

import math
import pickle
from typing import Any

import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.evaluation import auc, metrics
from moveit6d.evaluation.accumulate import (
    Accuracy,
    AreaUnderCurve,
    AverageRecall,
    Failures,
    FramesUntilLost,
    MeanError,
    MedianError,
    Stability,
    WithinLimits,
)
from moveit6d.evaluation.metrics import errors_of
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3, random_rotations

COUNT = 30
LOST = (4, 17)  # frames without an estimate


@pytest.fixture(scope="module")
def case() -> tuple[Pose, Pose, torch.Tensor]:
    """Estimates with two misses, the truth, and points of the object."""
    generator = torch.Generator().manual_seed(5)

    def noise(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, dtype=torch.float64, generator=generator)

    truth = Pose(random_rotations(COUNT, generator), noise(COUNT, 3) * 0.1)
    estimate = Pose(
        truth.rotation @ exp_so3(noise(COUNT, 3) * 0.1), truth.translation + noise(COUNT, 3) * 0.02
    )
    estimate.translation[LOST[0]] = math.nan
    estimate.rotation[LOST[1]] = math.inf
    return estimate, truth, noise(25, 3) * 0.04


def in_batches(metric: Any, estimate: Pose, truth: Pose, *what: Any, **options: Any) -> Any:
    """Feed 0 … 10, then one single pose, then the rest; also through a pickle on the way."""
    metric.update(estimate[:11], truth[:11], *what, **options)
    metric = pickle.loads(pickle.dumps(metric))
    metric.update(estimate[11], truth[11], *what, **options)
    metric.update(estimate[12:], truth[12:], *what, **options)
    return metric.compute()


def known(errors: torch.Tensor) -> torch.Tensor:
    return errors[torch.isfinite(errors)]


def test_misses_are_infinite_and_others_as_they_are(case: Any) -> None:
    estimate, truth, points = case
    for error in (metrics.add, metrics.adi):
        errors = errors_of(error, estimate, truth, points)
        assert [k for k in range(COUNT) if math.isinf(errors[k])] == list(LOST)
        torch.testing.assert_close(errors[5], error(estimate[5], truth[5], points))


def test_means_and_medians(case: Any) -> None:
    estimate, truth, points = case
    errors = errors_of(metrics.add, estimate, truth, points)
    mean = in_batches(MeanError(metrics.add, cut=0.1), estimate, truth, points)
    finite = known(errors).clamp_max(0.1)
    assert float(mean) == pytest.approx(float(finite.sum() + 0.2) / COUNT)
    assert math.isinf(in_batches(MeanError(metrics.add), estimate, truth, points))
    median = in_batches(MedianError(metrics.add), estimate, truth, points)
    assert float(median) == pytest.approx(float(errors.quantile(0.5)))


def test_accuracy_and_areas(case: Any) -> None:
    estimate, truth, points = case
    errors = errors_of(metrics.adi, estimate, truth, points)
    accuracy = in_batches(Accuracy(metrics.adi), estimate, truth, points, diameter=0.15)
    assert float(accuracy) == metrics.accuracy(errors, 0.015) > 0
    voc = in_batches(AreaUnderCurve(metrics.adi, "voc"), estimate, truth, points)
    exact = in_batches(AreaUnderCurve(metrics.adi, "exact", cap=0.05), estimate, truth, points)
    assert float(voc) == auc.voc_auc(errors) and float(exact) == auc.exact_auc(errors, 0.05)
    with pytest.raises(InputError, match="exact or voc"):
        AreaUnderCurve(metrics.add, "VOC")  # type: ignore[arg-type]


def test_shares_within_limits_count_misses_as_wrong(case: Any) -> None:
    estimate, truth, _ = case
    found = in_batches(WithinLimits(0.03, 8), estimate, truth)
    right = [
        math.dist(estimate.translation[k], truth.translation[k]) <= 0.03
        and float(metrics.rotation_error(estimate[k], truth[k])) <= 8
        for k in range(COUNT)
    ]
    assert float(found) == sum(right) / COUNT and 0 < sum(right) < COUNT - 2


def test_order_is_kept_for_tracks(case: Any) -> None:
    estimate, truth, points = case
    limit = 0.025
    errors = errors_of(metrics.add, estimate, truth, points)
    lost = in_batches(FramesUntilLost(metrics.add, limit, run=2), estimate, truth, points)
    assert int(lost) == metrics.frames_until_lost(errors, limit, 2) < COUNT
    far = Pose(truth.rotation, truth.translation + 1)
    assert int(in_batches(Failures(), far, truth)) == COUNT // 8
    assert int(in_batches(Failures(), truth, truth)) == 0


def test_stability_joins_batches_at_their_seams(case: Any) -> None:
    _, truth, _ = case
    metric = Stability()
    for part in (truth[:7], truth[7], truth[8:]):
        metric.update(part)
    shift, turn = metrics.stability(truth)
    found = metric.compute()
    assert float(found[0]) == pytest.approx(float(shift.mean()))
    assert float(found[1]) == pytest.approx(float(turn.mean()))


def test_average_recall_pools_over_images() -> None:
    recall = AverageRecall([0.1, 0.2])
    recall.update(torch.tensor([[0.05]]))  # right at both limits
    recall.update(torch.tensor([[0.15]]))  # at the wider one
    recall.update(torch.zeros(0, 2))  # nothing found of two
    assert float(recall.compute()) == pytest.approx((1 / 4 + 2 / 4) / 2)
    both = AverageRecall([0.1], kinds=2)
    both.update(torch.tensor([[[0.05, 0.3]]]))
    assert float(both.compute()) == 0.5


def test_states_of_two_processes_add_up(case: Any) -> None:
    """What torchmetrics does after gathering: sums are added, lists are joined."""
    estimate, truth, points = case
    halves = []
    for part in (slice(0, 9), slice(9, COUNT)):
        metric = Accuracy(metrics.add)
        metric.update(estimate[part], truth[part], points, diameter=0.2)
        halves.append(metric)
    halves[0].right += halves[1].right
    halves[0].total += halves[1].total
    whole = metrics.accuracy(errors_of(metrics.add, estimate, truth, points), 0.02)
    assert float(halves[0].compute()) == whole


@pytest.mark.filterwarnings("ignore:The ``compute`` method")
def test_nothing_given_is_said() -> None:
    for metric in (MeanError(metrics.add), Accuracy(metrics.add), AverageRecall([1.0])):
        with pytest.raises(InputError, match=r"no pose has been given|no true pose"):
            metric.compute()
