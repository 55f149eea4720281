"""Checks of configurations: probabilities and shares lie in [0, 1], ranges begin before they end.

Never knows what a value means beyond the name of its field.
"""

from __future__ import annotations

import math
from dataclasses import fields, is_dataclass
from typing import Any

from ..errors import InputError

POSITIVE = ("distance", "factor")  # ranges of numbers above 0, most of them drawn log-uniform


def check_settings(config: Any, path: str) -> None:
    """Check a dataclass and those within it; an `InputError` names the value's whole path.

    Fields called `share`, `probability`, or `…_probability`, must lie in [0, 1]; fields of type
    `Range` must be two finite numbers, the smaller one first; those in `POSITIVE`, above 0.
    """
    for item in fields(config):
        value, where = getattr(config, item.name), f"{path}.{item.name}"
        if is_dataclass(value):
            check_settings(value, where)
        elif item.name == "share" or item.name.endswith("probability"):
            if not 0 <= value <= 1:
                raise InputError(f"{where} must be from 0 to 1, found {value}.")
        elif item.type == "Range" and not (
            len(value) == 2 and value[0] <= value[1] and all(map(math.isfinite, value))
        ):
            raise InputError(
                f"{where} must be two numbers, the smaller one first, found {list(value)}."
            )
        elif item.type == "Range" and item.name in POSITIVE and not value[0] > 0:
            raise InputError(f"{where} must be above 0, found {list(value)}.")
