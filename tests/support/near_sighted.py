"""A policy that only finds an object that is near, and knows when it does not; for tests."""

from __future__ import annotations

import dataclasses

import torch

from moveit6d.actions import difference
from moveit6d.estimation.hypotheses import SURE
from moveit6d.geometry.crop import Crop
from moveit6d.geometry.pose import Pose
from moveit6d.networks.decision import Decision
from moveit6d.observation import Observation
from moveit6d.policies import MoveMode, Situation


@dataclasses.dataclass
class NearSighted:
    """Stays in doubt where it is, unless the truth is within `reach` counts on every axis."""

    truth: Pose  # centred, unbatched
    reach: float
    doubt: float = SURE - 0.3
    mode: MoveMode = MoveMode.ALL_AXES
    crop: Crop = "look_at"
    asked: int = 0

    def decide(self, seen: Observation, situation: Situation) -> Decision:
        count = len(situation.sphere_diameter)
        self.asked += count
        goal = Pose.stack([self.truth] * count)
        counts = difference(situation.pose, goal, situation.sphere_diameter)
        near = counts.abs().amax(-1) < self.reach
        confidence = torch.where(near, 0.95, self.doubt)
        return Decision(torch.zeros(count, 13), counts * near[:, None], confidence)
