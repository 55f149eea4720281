"""`track --exact_start`: the tracker calibrates from the first frame, and what it saw is said.

Never writes a file.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import TYPE_CHECKING

from .messages import note

if TYPE_CHECKING:
    from ..datasets.video import VideoFrame
    from ..evaluation.run_tracker import AnyTracker

TOLD = 0.01  # difference in size from which users are told


def from_exact_start(
    tracker: AnyTracker, names: Sequence[str], frames: Iterable[VideoFrame]
) -> Iterator[VideoFrame]:
    """The same frames; from the first, in which its start poses are exact, the tracker calibrates.

    A note where that frame cannot be read, and for each object (`names`) that looks larger or
    smaller there than its mesh.
    """
    from ..evaluation.run_tracker import calibrating

    for number, frame in enumerate(calibrating(tracker, frames)):
        if number == 0:
            if frame.image is None:
                note(
                    "--exact_start: the first frame cannot be read, so that nothing is calibrated."
                )
            for name, track in zip(names, tracker.tracks, strict=True):
                _tell_size(name or "the object", track.size)
        yield frame


def _tell_size(name: str, size: float) -> None:
    if abs(size - 1) < TOLD:
        return
    how = "larger" if size > 1 else "smaller"
    note(
        f"--exact_start: in the first frame {name} looks {100 * abs(size - 1):.1f} % {how} than "
        "its mesh at that pose, and is followed as it looks. The size of the mesh, the camera's "
        "focal length or the start's distance is off by that."
    )
