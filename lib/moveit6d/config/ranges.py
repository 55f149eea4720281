"""Ranges that settings must lie in, and the refusal of those that do not.

Never computes anything.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ..errors import InputError

# None of them holds for numbers that are none.
RANGES: dict[str, Callable[[float], bool]] = {
    "0 or more": lambda value: value >= 0,
    "1 or more": lambda value: value >= 1,
    "above 0": lambda value: value > 0,
    "from 0 to 1": lambda value: 0 <= value <= 1,
    "0 or more and finite": lambda value: 0 <= value < math.inf,
    "above 0 and finite": lambda value: 0 < value < math.inf,
}


def check_range(config: Any, what: str, *names: str) -> None:
    """Refuse fields of a configuration that are, or hold, a number outside of a range of `RANGES`.

    The `InputError` names class, field and value.
    """
    for name in names:
        value = getattr(config, name)
        numbers = value if isinstance(value, tuple) else (value,)
        if not all(map(RANGES[what], numbers)):
            raise InputError(f"{type(config).__name__}: {name} must be {what}, found {value}.")
