"""Says while a track runs that it began badly, that the object may be lost, and that it is back.

Never changes a track.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import TYPE_CHECKING

from .messages import note

if TYPE_CHECKING:
    from ..evaluation.run_tracker import TrackedFrame

FIRST = 3  # frames after which a start that never became confident is named
LOST = 10  # frames in a row without confidence that are named


def watching(steps: Iterable[TrackedFrame], prefix: str = "") -> Iterator[TrackedFrame]:
    """The same frames, with a line on stderr where the confidence goes and comes back."""
    low = 0
    began = lost = False
    for count, step in enumerate(steps, 1):
        low = 0 if step.confident else low + 1
        if step.confident:
            if lost:
                note(f"{prefix}frame {step.frame.index}: confident again.")
            began, lost = True, False
        elif not began and count == FIRST:
            note(
                f"{prefix}the first {FIRST} frames have confidence {_confidence(step)}: is the "
                "start pose right, and the mesh, its unit and the camera?"
            )
            lost = True
        elif began and low == LOST:
            first = step.frame.index - LOST + 1
            note(f"{prefix}the object may be lost from frame {first} on.")
            lost = True
        yield step


def _confidence(step: TrackedFrame) -> str:
    confidence = step.row.confidence
    return "0" if confidence is None else f"{confidence:.2f}"
