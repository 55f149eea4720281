"""A policy that only finds an object that is near, and knows when it does not; for tests."""

from __future__ import annotations

import dataclasses

import torch

from moveit6d.actions import pose_delta
from moveit6d.config import ActionMode
from moveit6d.geometry.crop import Crop
from moveit6d.geometry.pose import Pose
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.observation import Observation
from moveit6d.policies import LoopState
from tests.support.configs import HIGH_CONFIDENCE


@dataclasses.dataclass
class NearSighted:
    """Has a low confidence and stays, unless the truth is within `reach` units on every axis."""

    truth: Pose  # centred, unbatched
    reach: float
    doubt: float = HIGH_CONFIDENCE - 0.3
    mode: ActionMode = ActionMode.ALL_AXES
    crop: Crop = "look_at"
    asked: int = 0

    def predict(self, observation: Observation, state: LoopState) -> PolicyOutput:
        count = len(state.sphere_diameter)
        self.asked += count
        goal = Pose.stack([self.truth] * count)
        delta = pose_delta(state.pose, goal, state.sphere_diameter)
        near = delta.abs().amax(-1) < self.reach
        confidence = torch.where(near, 0.95, self.doubt)
        return PolicyOutput(torch.zeros(count, 13), delta * near[:, None], confidence)


@dataclasses.dataclass
class Numbered(NearSighted):
    """Keeps the numbers of the objects that it is asked for."""

    numbers: set[int] = dataclasses.field(default_factory=set)

    def predict(self, observation: Observation, state: LoopState) -> PolicyOutput:
        self.numbers |= set(state.target.tolist())
        return super().predict(observation, state)
