"""Targets of a single image whose start poses are of no use: the objects are looked for instead.

Never changes a pose that could be refined.
"""

from __future__ import annotations

from collections.abc import Sequence

from ..config import TrackerConfig
from ..frame import prepare_frame
from ..policies import Policy
from ..rendering.renderer import Renderer
from .detection import PoseDetector, TemplateStore, can_search, detect_objects
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
    does, accepted or not: `confidence` is the probability that the pose is right, given that the
    object is in the image. Empty for a policy that cannot search, in mode single, and with
    `recovery` off.

    Example:
        >>> import numpy as np
        >>> from moveit6d import Camera, Mesh, Pose, load_policy, make_renderer
        >>> from moveit6d.estimation import Target, refine_single
        >>> corners = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
        >>> mesh = Mesh.from_arrays("corner", corners, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
        >>> camera = Camera(300, 300, 159.5, 119.5, 320, 240)
        >>> behind = Pose.from_rvec([0, 0, 0], [0, 0, -0.5])
        >>> targets = [Target(np.zeros((240, 320, 3), np.uint8), camera, mesh, behind)]
        >>> tools = {"policy": load_policy(), "renderer": make_renderer()}
        >>> found = search_lost_targets(targets, refine_single(targets, **tools), **tools)
        >>> all(one.confidence < 0.3 for one in found.values())  # there is nothing in the image
        True
    """
    lost = _lost(targets, results)
    if not lost or not can_search(policy, config):
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
        for first, *_ in lost
    ]
    first = targets[lost[0][0]]
    frame = prepare_frame(first.image, first.camera)
    detections = detect_objects(detectors, frame, [len(rows) for rows in lost])
    return {
        row: found.known_present(config.detection.verification).result
        for rows, detection in zip(lost, detections, strict=True)
        for row, found in zip(rows, (*detection.instances, *detection.rejected), strict=False)
    }


def _lost(targets: Sequence[Target], results: Sequence[TrackingResult]) -> list[list[int]]:
    """Indices of the targets of each object of which none could be refined."""
    refined = {
        id(target.mesh)
        for target, result in zip(targets, results, strict=True)
        if result.pose is not None
    }
    lost: dict[int, list[int]] = {}
    for index, target in enumerate(targets):
        if id(target.mesh) not in refined:
            lost.setdefault(id(target.mesh), []).append(index)
    return list(lost.values())
