"""What may have kept objects from being found in any frame of a video.

Never tracks.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from .messages import note

if TYPE_CHECKING:
    from ..evaluation.run_tracker import AnyTracker, TrackSummary
    from ..geometry.pose import Pose


def say_why(
    tracker: AnyTracker,
    records: Sequence[TrackSummary],
    names: Sequence[str],
    starts: Sequence[Pose | None],
) -> None:
    """Notes for objects without a pose in all frames of a track that began at these poses."""
    never = [k for k, one in enumerate(records) if one.failed == one.frames and one.milliseconds]
    limit = tracker.config.recovery.max_milliseconds
    # A search that ends leaves a check of what it found, if anything.
    unfinished = [names[k] for k in never if tracker.supervisors[k].check is None]
    if limit is not None and unfinished:
        whose = f" for {', '.join(unfinished)}" if any(unfinished) else ""
        note(
            f"no search{whose} was finished before the video ended: --max_milliseconds {limit:g} "
            "is too short for it; give a larger value, or leave it out."
        )
    searched = [k for k in never if starts[k] is None]
    plain = [names[k] for k in searched if not tracker.meshes[k].has_colours]
    if plain:
        whose = f"the meshes of {', '.join(plain)} have" if any(plain) else "the mesh has"
        note(
            f"{whose} no colours, which is the likely reason: a search compares colours. Give the "
            "pose in the first frame, by --start or --points, and --texture_from_start."
        )
