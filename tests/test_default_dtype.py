"""A program whose tensors are float64 by default gets the poses that every other one gets."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import torch

from moveit6d import PoseDetector, PoseTracker
from moveit6d.networks.weights_file import load_network
from moveit6d.policies import SHIPPED_WEIGHTS, NetworkPolicy


@contextmanager
def float64_by_default() -> Iterator[None]:
    torch.set_default_dtype(torch.float64)
    try:
        yield
    finally:
        torch.set_default_dtype(torch.float32)


def a_policy() -> NetworkPolicy:
    return NetworkPolicy(load_network(SHIPPED_WEIGHTS).network)


def found(scene: Any, policy: NetworkPolicy) -> list[Any]:
    """Poses of a track, with the last one's covariance, and of a search."""
    tracker = PoseTracker(scene.mesh, scene.camera, scene.pose(0), policy=policy)
    tracker.calibrate(scene.image(0))
    results = [tracker.update(scene.image(number)) for number in (1, 2)]
    detection = PoseDetector(scene.mesh, scene.camera, policy=policy).detect(scene.image(0))
    poses = [one.pose.matrix for one in results if one.pose is not None]
    assert detection.pose is not None
    return [*poses, torch.as_tensor(results[-1].covariance), detection.pose.matrix]


def test_poses_do_not_depend_on_the_programs_default_type(scene: Any) -> None:
    before = a_policy()
    wanted = found(scene, before)
    with float64_by_default():
        for policy in (before, a_policy()):
            for one, other in zip(found(scene, policy), wanted, strict=True):
                torch.testing.assert_close(one, other, rtol=1e-3, atol=2e-5, check_dtype=False)
