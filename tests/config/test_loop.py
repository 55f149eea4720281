"""The settings of the loop: limits by mode, and what cannot be right."""

from __future__ import annotations

from typing import Any

import pytest

from moveit6d.config import ActionMode, LoopConfig
from moveit6d.errors import InputError


def test_the_limit_of_iterations_is_the_modes_unless_it_is_given() -> None:
    assert LoopConfig().limit(ActionMode.SINGLE) == 30
    assert LoopConfig().limit(ActionMode.ALL_AXES) == 8
    assert LoopConfig(max_iterations=3).limit(ActionMode.SINGLE) == 3


def test_the_difference_of_poses_is_in_step_sizes_for_single_actions_only() -> None:
    loop = LoopConfig(step_size=0.4, revisit_delta=0.3)
    assert loop.same_pose(ActionMode.SINGLE) == pytest.approx(0.12)
    assert loop.same_pose(ActionMode.ALL_AXES) == 0.3
    assert LoopConfig().same_pose(ActionMode.SINGLE) == 0.5


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"mode": "both"}, "no mode 'both'; choose one of single, all_axes"),
        ({"max_iterations": 0}, "max_iterations must be 1 or more, found 0"),
        ({"step_size": 0.0}, "step_size must be positive"),
        ({"fine_scale": 0.5}, "fine_scale 1 or more"),
        ({"augment_size": 200}, "augment_size must be a multiple of 32 and 128 or more, found 200"),
        ({"augment_size": 96}, "augment_size must be .* found 96"),
        ({"width_error": 0.0}, "width_error must be positive"),
    ],
)
def test_what_cannot_be_right_is_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        LoopConfig(**given)
