"""Other starts for followed objects of low confidence: around the recovery poses of their tracks.

Never replaces a result by a less confident one, and never searches an image.
"""

from __future__ import annotations

from collections.abc import Mapping

from ..config import TrackerConfig
from ..frame import Frame
from ..policies import Policy
from ..rendering.renderer import Renderer
from .apart import Instances
from .multi_start import most_confident, recovery_starts, uses_multi_start
from .results import Refined


def recovered(
    frame: Frame,
    results: Mapping[int, Refined],
    instances: Instances,
    *,
    policy: Policy,
    renderer: Renderer,
    config: TrackerConfig,
) -> dict[int, Refined]:
    """The results, by number; one of low confidence is replaced by the best from recovery poses.

    Only by one that is not low: an occluded object has a low confidence where it is. And only
    where no other instance is.
    """
    if not uses_multi_start(policy, config):
        return dict(results)
    low, sure, tracks = config.low_confidence, instances.sure(results), instances.tracks
    others = [
        [
            start
            for start in recovery_starts(frame, tracks[number])
            if not instances.stands_on_another(number, start.centred, sure)
        ]
        if result.confidence < low and tracks[number].is_recovery_due()
        else []
        for number, result in results.items()
    ]
    ends = most_confident(
        list(results.values()),
        others,
        policy=policy,
        renderer=renderer,
        config=config,
        race=config.multi_start.race,
        targets=list(results),
    )
    found = dict(results)
    for (number, old), new in zip(results.items(), ends, strict=True):
        if new is old or new.centred is None or new.confidence < low:
            continue
        if not instances.stands_on_another(number, new.centred, sure):
            found[number] = new
    return found
