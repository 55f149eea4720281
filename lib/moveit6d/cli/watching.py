"""Says while a track runs that it began badly, that the object may be lost, and that it is back.

Never changes a track.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from .messages import note

if TYPE_CHECKING:
    from ..evaluation.run_tracker import TrackedFrame

FIRST = 3  # frames after which a start that never became confident is named
LOST = 10  # frames in a row without confidence that are named


@dataclass
class Watcher:
    """Watches one object's frames; a line on stderr where they fail, and where confidence goes."""

    prefix: str = ""
    _count: int = 0
    _low: int = 0
    _error: str | None = None
    _began: bool = False
    _lost: bool = False

    def see(self, step: TrackedFrame) -> None:
        """The next frame."""
        self._count += 1
        if step.error is not None and step.error != self._error:
            self._say(f"frame {step.frame.index}: {step.error}")
        self._error = step.error
        if step.confident:
            if self._lost:
                what = "confident again" if self._began else "found"
                self._say(f"frame {step.frame.index}: {what}.")
            self._low, self._began, self._lost = 0, True, False
            return
        self._low += 1
        if step.row.state == "lost" and (self._began or self._count == 1):
            self._lost = True  # the error says so
        elif not (self._began or self._lost) and self._count == FIRST:
            self._say(
                f"the first {FIRST} frames have confidence {_confidence(step)}: is the start pose "
                "right, and the mesh, its unit and the camera?"
            )
            self._lost = True
        elif self._began and not self._lost and self._low == LOST:
            first = step.frame.index - LOST + 1
            self._say(f"the object may be lost from frame {first} on.")
            self._lost = True

    def _say(self, text: str) -> None:
        note(self.prefix + text)


def _confidence(step: TrackedFrame) -> str:
    confidence = step.row.confidence
    return "0" if confidence is None else f"{confidence:.2f}"
