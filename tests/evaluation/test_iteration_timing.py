"""The time of a cycle: the parts are all there and make up the whole."""

from __future__ import annotations

from typing import Any

import torch

from moveit6d.evaluation.iteration_timing import PARTS, WARM_UP, time_iteration
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from moveit6d.rendering.backends import make_renderer


def test_every_part_is_timed_once_a_round(scene: Any) -> None:
    far = torch.tensor([[0.0, 0.0, 0.4]], dtype=torch.float64)
    policy = OraclePolicy(Pose(torch.eye(3, dtype=torch.float64)[None], far))
    rounds = iter(range(WARM_UP + 3))
    times = time_iteration(scene.mesh, policy, make_renderer(), rounds)
    assert next(rounds, None) is None, "all rounds were used"
    assert tuple(times.parts) == PARTS and min(times.parts.values()) > 0
    # Whatever else the machine does: no round is shorter than one of its parts.
    assert times.total >= max(times.parts.values()) and times.whole > 0
