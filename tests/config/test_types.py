"""Each setting takes one kind of value, whoever gives it; the refusal names the setting."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from moveit6d.config import ContourConfig, KeyframeConfig, LoopConfig, TrackerConfig
from moveit6d.errors import InputError


@pytest.mark.parametrize(
    ("values", "said"),
    [
        ({"loop": {"max_iterations": 4}}, r"loop must be a LoopConfig, found \{'max_iter"),
        ({"contour": False}, "contour must be a ContourConfig, found False"),
        ({"contour": None}, "contour must be a ContourConfig, found None"),
        ({"low_confidence": "0.4"}, "low_confidence must be a number, found '0.4'"),
        ({"low_confidence": True}, "low_confidence must be a number, found True"),
        (
            {"loop": LoopConfig(max_iterations=2.5)},  # type: ignore[arg-type]
            r"loop\.max_iterations must be a whole number or None, found 2\.5",
        ),
        (
            {"keyframes": KeyframeConfig(enabled="yes")},  # type: ignore[arg-type]
            r"keyframes\.enabled must be True or False, found 'yes'",
        ),
    ],
)
def test_another_kind_of_value_is_refused_by_name(values: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=rf"TrackerConfig\.{said}"):
        TrackerConfig(**values)


def test_numbers_of_other_libraries_and_whole_ones_for_any_are_taken() -> None:
    loop = LoopConfig(max_iterations=np.int64(3), stop_delta=1)  # type: ignore[arg-type]
    config = TrackerConfig(low_confidence=np.float32(0.25), loop=loop)  # type: ignore[arg-type]
    assert (config.loop.max_iterations, config.low_confidence) == (3, 0.25)
    assert TrackerConfig(contour=ContourConfig(enabled=False)).contour.enabled is False
