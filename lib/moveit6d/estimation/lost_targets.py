"""Targets of a single image whose start poses are of no use: the objects are looked for instead.

Never changes a pose that could be refined.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..config import ActionMode, TrackerConfig
from ..frame import prepare_frame
from ..policies import DescriptorPolicy, Policy, mode_of
from ..rendering.renderer import Renderer
from .detection import PoseDetector, TemplateStore, detect_objects
from .estimator import DEFAULT
from .results import Target, TrackingResult


def search_lost_targets(
    targets: Sequence[Target],
    results: Sequence[TrackingResult],
    *,
    policy: Policy,
    renderer: Renderer,
    config: TrackerConfig = DEFAULT,
    store: TemplateStore | None = None,
) -> dict[int, TrackingResult]:
    """The most probable poses of objects of which no target of one image could be refined.

    `results` are those of `refine_single`; keys are indices of `targets`. Found as `PoseDetector`
    does, accepted or not: `confidence` is the probability that the pose is right. Empty for a
    policy that cannot search, in mode single, and with `recovery` off.
    """
    refined = {
        id(target.mesh)
        for target, result in zip(targets, results, strict=True)
        if result.pose is not None
    }
    lost: dict[int, list[int]] = {}
    for index, target in enumerate(targets):
        if id(target.mesh) not in refined:
            lost.setdefault(id(target.mesh), []).append(index)
    single = mode_of(policy, config.loop.mode) is ActionMode.SINGLE
    searches = config.recovery.enabled and isinstance(policy, DescriptorPolicy) and not single
    if not lost or not searches:
        return {}
    store = store or TemplateStore()
    detectors = [
        PoseDetector(
            targets[first].mesh,
            targets[first].camera,
            policy=policy,
            renderer=renderer,
            config=config,
            store=store,
            threads=None,
        )
        for first, *_ in lost.values()
    ]
    first = targets[next(iter(lost.values()))[0]]
    frame = prepare_frame(first.image, first.camera)
    detections = detect_objects(detectors, frame, [len(rows) for rows in lost.values()])
    return {
        row: found.result
        for rows, detection in zip(lost.values(), detections, strict=True)
        for row, found in zip(rows, (*detection.instances, *detection.rejected), strict=False)
    }
