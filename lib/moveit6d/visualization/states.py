"""A tracker's states in a report: from which frame to which they lasted, and bands that show it.

Never says what state a frame has; its row does.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ..datasets.pose_files import PoseRow
from ..estimation.states import Event, TrackingState, add_event


def events_of(rows: Mapping[int, PoseRow]) -> list[Event]:
    """The states in the order of the frames, as `summary.json` has them; none without states."""
    events: list[Event] = []
    for frame in sorted(rows):
        if rows[frame].state:
            add_event(events, rows[frame].state, frame)
    return events


def bands(events: Sequence[Event], limits: Mapping[str, float]) -> list[dict[str, Any]]:
    """Where an object is not tracked: state, and left end and width in % of the curves' width.

    `limits` say which frames the ends of the curves are (`curves.limits`).
    """
    first, last = limits["first"], limits["last"]
    width = 100 * (limits["right"] - limits["left"]) / (last - first)
    return [
        {
            "state": event["state"],
            "left": round(100 * limits["left"] + width * (event["first"] - 0.5 - first), 3),
            "width": round(width * (event["last"] - event["first"] + 1), 3),
        }
        for event in events
        if event["state"] != TrackingState.TRACKING
    ]


def one_per_loss(
    badness: Mapping[int, float], rows: Mapping[int, PoseRow], most: int
) -> dict[int, float]:
    """How bad the frames are that are worth a picture: one of each loss, of `most` losses.

    A loss are the frames without a pose, or of a lost object, that follow each other: in one the
    object may be seen, the first, and a hundred of them look the same.
    """
    lost: list[Event] = []
    for frame in sorted(rows):
        add_event(lost, "lost" if _is_lost(rows[frame]) else "", frame)
    kept = [event["first"] for event in lost if event["state"]]
    kept = sorted(kept, key=lambda frame: (-badness[frame], frame))[:most]
    return {
        frame: value
        for frame, value in badness.items()
        if frame in kept or not _is_lost(rows[frame])
    }


def _is_lost(row: PoseRow) -> bool:
    return row.pose is None or row.state == TrackingState.LOST
