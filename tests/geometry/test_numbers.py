"""Numbers of every kind become tensors; what are none is one sentence."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.geometry.numbers import float64_of, floating, vectors


@pytest.mark.parametrize("values", [[1, 2], (1.0, 2.0), np.array([1, 2]), torch.tensor([1, 2])])
def test_every_kind_of_numbers(values: Any) -> None:
    expected = torch.tensor([1.0, 2.0], dtype=torch.float64)
    for found in (float64_of(values, "f", "x"), floating(values, "f", "x")):
        assert torch.equal(found, expected) and found.dtype == torch.float64


def test_a_tensor_of_floating_point_numbers_stays_as_it_is() -> None:
    values = torch.ones(2, 3, requires_grad=True)
    assert floating(values, "f", "x") is values and vectors(values, 3, "f", "x") is values
    assert not float64_of(values, "f", "x").requires_grad


@pytest.mark.parametrize("values", ["a", [[1.0], [1.0, 2.0]], object(), {"x": 1}])
def test_what_are_no_numbers_is_said(values: Any) -> None:
    for check in (float64_of, floating):
        with pytest.raises(InputError, match="f: the x must be numbers, found"):
            check(values, "f", "x")


@pytest.mark.parametrize("values", [1.0, [1.0, 2.0], torch.zeros(3, 2)])
def test_vectors_of_another_length_are_said(values: Any) -> None:
    with pytest.raises(InputError, match=r"f: x must be \(\.\.\., 3\), found shape"):
        vectors(values, 3, "f", "x")
