"""Both areas against vectors of the toolbox, against integration, and against each other."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from moveit6d.errors import InputError
from moveit6d.evaluation.metrics.auc import exact_auc, opt_score, voc_auc

INF = math.inf


def tensor(values: list[float]) -> torch.Tensor:
    return torch.tensor(values, dtype=torch.float64)


@pytest.mark.parametrize(
    ("errors", "voc", "exact"),
    [
        ([0.05, 0.05], 0.75, 0.5),
        ([0.02], 1.0, 0.8),
        ([1.0, 2.0], 0.0, 0.0),
        ([0.0, 0.0], 1.0, 1.0),
        ([0.1], 1.0, 0.0),  # the cap itself is not above the cap
        ([INF, 0.02], 0.5, 0.4),
        ([math.nan, 0.02], 0.5, 0.4),
        ([INF, INF], 0.0, 0.0),
    ],
)
def test_vectors(errors: list[float], voc: float, exact: float) -> None:
    assert voc_auc(tensor(errors)) == pytest.approx(voc)
    assert exact_auc(tensor(errors)) == pytest.approx(exact)


def by_the_toolbox(errors: list[float], cap: float) -> float:
    """The steps of plot_accuracy_keyframe.m, one by one."""
    ordered = sorted(e if e <= cap else INF for e in errors)
    recall, accuracy = [0.0], [0.0]
    for k, e in enumerate(ordered, 1):
        if math.isfinite(e):
            recall.append(e)
            accuracy.append(k / len(ordered))
    recall, accuracy = [*recall, cap], [*accuracy, accuracy[-1]]
    for k in range(1, len(accuracy)):
        accuracy[k] = max(accuracy[k - 1 : k + 1])
    area = 0.0
    for k in range(1, len(recall)):
        if recall[k] != recall[k - 1]:
            area += (recall[k] - recall[k - 1]) * accuracy[k]
    return area / cap


LISTS = st.lists(
    st.one_of(st.floats(0, 0.3), st.sampled_from([0.0, 0.05, 0.1, INF])), min_size=1, max_size=40
)


@given(LISTS)
def test_the_voc_form_follows_the_toolbox(errors: list[float]) -> None:
    assert voc_auc(tensor(errors)) == pytest.approx(by_the_toolbox(errors, 0.1), abs=1e-12)


@given(LISTS)
def test_the_forms_differ_by_the_largest_error_below_the_cap(errors: list[float]) -> None:
    below = [error for error in errors if error <= 0.1]
    expected = max(below) / (0.1 * len(errors)) if below else 0.0
    difference = voc_auc(tensor(errors)) - exact_auc(tensor(errors))
    assert difference == pytest.approx(expected, abs=1e-12)


def test_the_exact_form_is_the_integral_of_the_curve() -> None:
    errors = np.random.default_rng(0).gamma(2, 0.03, 50)
    places = (np.arange(200_000) + 0.5) / 200_000 * 0.1
    shares = np.searchsorted(np.sort(errors), places, side="right") / len(errors)
    assert exact_auc(torch.from_numpy(errors)) == pytest.approx(shares.mean(), abs=1e-5)


def test_the_pooled_area_is_not_the_mean_of_the_classes() -> None:
    good, bad = tensor([0.01] * 9), tensor([INF])
    assert exact_auc(torch.cat([good, bad])) == pytest.approx(0.81)
    assert (exact_auc(good) + exact_auc(bad)) / 2 == pytest.approx(0.45)


def test_opt_gives_20_to_a_perfect_track() -> None:
    assert opt_score(tensor([0.0, 0.0]), 0.11) == pytest.approx(20)
    # One frame at a tenth of the diameter: half of its area; one lost frame: nothing.
    assert opt_score(tensor([0.011, INF]), 0.11) == pytest.approx(5)


@pytest.mark.parametrize("errors", [torch.zeros(0), torch.zeros(2, 2), tensor([-0.1])])
def test_what_are_no_errors_is_refused(errors: torch.Tensor) -> None:
    for area in (exact_auc, voc_auc):
        with pytest.raises(InputError, match="area under a curve"):
            area(errors)
