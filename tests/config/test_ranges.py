"""A range is checked of a field and of all that it holds; numbers that are none lie in no range."""

from __future__ import annotations

import math
from dataclasses import dataclass

import pytest

from moveit6d.config.ranges import RANGES, check_range
from moveit6d.errors import InputError


@dataclass(frozen=True)
class _Config:
    width: float = 1.0
    both: tuple[float, float] = (1.0, 1.0)


@pytest.mark.parametrize("what", RANGES)
def test_one_lies_in_every_range_and_no_number_in_none(what: str) -> None:
    check_range(_Config(), what, "width", "both")
    for given in (_Config(width=math.nan), _Config(both=(1.0, math.nan)), _Config(width=-1.0)):
        with pytest.raises(InputError, match=f"_Config: (width|both) must be {what}, found"):
            check_range(given, what, "width", "both")


def test_only_the_fields_that_are_named_are_looked_at() -> None:
    check_range(_Config(width=-1.0), "above 0", "both")
    check_range(_Config(width=math.inf), "0 or more", "width")
    with pytest.raises(InputError, match="found inf"):
        check_range(_Config(width=math.inf), "0 or more and finite", "width")
