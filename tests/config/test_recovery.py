"""The settings of states and recovery refuse what cannot be right."""

from __future__ import annotations

from typing import Any

import pytest

from moveit6d.config import RecoveryConfig, StateConfig
from moveit6d.errors import InputError


@pytest.mark.parametrize(
    ("kind", "given", "message"),
    [
        (StateConfig, {"doubted": 0.8}, "rejected ≤ doubted ≤ confirmed"),
        (StateConfig, {"frames_to_lose": 0}, "1 or more"),
        (RecoveryConfig, {"interval": 0}, "interval and near_candidates must be 1 or more"),
        (RecoveryConfig, {"max_milliseconds": -1.0}, "must not be negative"),
    ],
)
def test_what_cannot_be_right_is_refused(kind: type, given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        kind(**given)
