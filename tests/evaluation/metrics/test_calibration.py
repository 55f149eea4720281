"""Bins by hand, a calibrated confidence by its definition, and what is refused."""

from __future__ import annotations

import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.evaluation.metrics.calibration import reliability


def test_bins_by_hand() -> None:
    found = reliability(
        torch.tensor([0.05, 0.15, 0.17, 0.95, 1.0]), torch.tensor([0, 1, 0, 1, 1]), bins=10
    )
    assert found.counts.tolist() == [1, 2, 2]
    assert found.right.tolist() == [0.0, 0.5, 1.0]
    assert found.confidence.tolist() == pytest.approx([0.05, 0.16, 0.975])
    assert found.calibration_error == pytest.approx((0.05 + 2 * 0.34 + 2 * 0.025) / 5)
    assert found.auroc == pytest.approx(5 / 6)


def test_outcomes_drawn_by_the_confidence_are_calibrated_and_others_are_not() -> None:
    generator = torch.Generator().manual_seed(0)
    confidence = torch.rand(20_000, generator=generator)
    right = torch.rand(20_000, generator=generator) < confidence
    assert reliability(confidence, right).calibration_error < 0.01
    # E|p² - p| of a uniform p is 1/6.
    assert reliability(confidence.square(), right).calibration_error == pytest.approx(
        1 / 6, abs=0.02
    )


@pytest.mark.parametrize("values", [[], [1.2], [-0.1], [float("nan")]])
def test_what_is_no_probability_is_refused(values: list[float]) -> None:
    with pytest.raises(InputError):
        reliability(torch.tensor(values), torch.zeros(len(values)))
