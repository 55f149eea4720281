"""Searches in short steps: taken to their end, or as far as the time goes.

Never searches by itself.
"""

from __future__ import annotations

import time
from collections.abc import Generator

from .found import Detection

Steps = Generator[None, None, Detection]


def within(steps: Steps, milliseconds: float | None) -> Detection | None:
    """What a search finds if it ends within so much time; None if it is to go on later."""
    begin = time.perf_counter()
    while True:
        try:
            next(steps)
        except StopIteration as end:
            found: Detection = end.value
            return found
        if milliseconds is not None and (time.perf_counter() - begin) * 1e3 >= milliseconds:
            return None


def finish(steps: Steps) -> Detection:
    """Take the steps of a detection to their end."""
    found = within(steps, None)
    assert found is not None
    return found
