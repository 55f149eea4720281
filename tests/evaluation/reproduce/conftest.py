"""What reproductions are tried on."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import pytest

from moveit6d.datasets.sequences import Sequence, read_sequences


@pytest.fixture
def video(make_sequence: Callable[..., Any]) -> Sequence:
    return read_sequences(make_sequence("easy_00", frames=3, still=True).folder)[0]
