"""Searches in short steps: taken to their end, or as far as the time goes.

Never searches by itself.
"""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import dataclass
from typing import Generic, TypeVar

from .found import Detection

Steps = Generator[None, None, Detection]
Found = TypeVar("Found")


@dataclass(frozen=True)
class Ended(Generic[Found]):
    """What steps came to in the end."""

    found: Found


def within(steps: Generator[None, None, Found], milliseconds: float | None) -> Ended[Found] | None:
    """What steps come to if they end within so much time; None if they are to go on later."""
    begin = time.perf_counter()
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return Ended(end.value)
        if milliseconds is not None and (time.perf_counter() - begin) * 1e3 >= milliseconds:
            return None


def finish(steps: Steps) -> Detection:
    """Take the steps of a detection to their end."""
    ended = within(steps, None)
    assert ended is not None
    return ended.found
