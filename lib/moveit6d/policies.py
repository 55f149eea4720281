"""Who decides the next move: a network, or an oracle that knows the true pose.

Never renders and never applies a move.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor
from torch.nn import functional

from .actions import PoseAction, difference, expert_action
from .errors import InputError
from .geometry.crop import Crop
from .geometry.pose import Pose
from .networks.action_net import ActionNet
from .networks.correlation import CorrelationNet
from .networks.decision import Decision
from .networks.inference import Compute, InferenceNetwork
from .networks.weights_file import load_network
from .observation import Observation, mirrored, turned

SHIPPED_WEIGHTS = Path(__file__).parent / "weights" / "multi_object.safetensors"


class MoveMode(StrEnum):
    """How a decision becomes a move."""

    SINGLE = "single"  # the paper: the best of the 13 actions, one step long
    ALL_AXES = "all_axes"  # all six real-valued counts at once (METHOD 9a)


@dataclass(frozen=True)
class Situation:
    """Where the loop stands: for policies that know more than what is seen.

    `pose` (B) is centred, object → camera; `sphere_diameter` (B,) in metres; `target` (B,) says
    which of the loop's targets each row is, or which group of them where several are starts for
    one object.
    """

    pose: Pose
    sphere_diameter: Tensor
    target: Tensor


class Policy(Protocol):
    """Decides from observations; `mode` says how its decisions are carried out.

    `crop` is the kind of patches that it wants to see, and in which its counts are measured.
    """

    mode: MoveMode
    crop: Crop

    def decide(self, seen: Observation, situation: Situation) -> Decision:
        """A decision for each observation of the batch."""
        ...


@runtime_checkable
class DescriptorPolicy(Policy, Protocol):
    """A policy that also says what places in images look like: what detection searches with."""

    def descriptors(self, images: Tensor) -> Tensor:
        """A descriptor for each cell of 8 × 8 pixels: (B, 3, H, W) in [0, 1] → (B, C, h, w)."""
        ...


def choose_move(decision: Decision, mode: MoveMode, step: float = 1.0) -> PoseAction:
    """The move that a decision stands for.

    In mode `single` the action with the highest score, `step` units long. In mode `all_axes` the
    six counts as they are; it also stops if the stop action scores highest or every count is under
    half a step, and the remainder is applied as the last move.
    """
    best = decision.logits.argmax(-1)
    if mode is MoveMode.SINGLE:
        return PoseAction.from_index(best, step)
    if decision.counts is None:
        raise InputError(
            "This network only chooses single actions: use the move mode 'single' with it."
        )
    done = decision.counts.abs().amax(-1) < 0.5 * step
    return PoseAction(decision.counts.to(torch.float64), (best == 12) | done)


class NetworkPolicy:
    """Decides with a trained network, in evaluation mode, without gradients."""

    def __init__(
        self, network: CorrelationNet | ActionNet, mode: MoveMode | None = None, source: str = "",
        compute: Compute = "auto",
    ) -> None:  # fmt: skip
        self.network = InferenceNetwork(network, compute)
        single = isinstance(network, ActionNet)
        self.crop: Crop = network.config.crop
        self.mode = mode or (MoveMode.SINGLE if single else MoveMode.ALL_AXES)
        self.source = source  # what the weights are, for reports
        if single and self.mode is not MoveMode.SINGLE:
            raise InputError("The paper's network only chooses single actions: use mode 'single'.")

    def decide(self, seen: Observation, situation: Situation) -> Decision:
        """One pass of the network."""
        return self.network(seen)


    def descriptors(self, images: Tensor) -> Tensor:
        """What each cell of 8 × 8 pixels looks like: images (B, 3, H, W) → (B, C, H / 8, W / 8)."""
        return self.network.descriptors(images)


class TurnedPolicy:
    """Asks another policy about what is seen laid in all eight ways, and takes the mean.

    By quarter turns, and each of them in the mirror: what it gets wrong is not the same in all.
    Scores of single actions and the attention are those of what is seen.
    """

    # Of the six counts where right and left change places: shifts along x and turns about y and z.
    SIGNS = (-1.0, 1.0, 1.0, 1.0, -1.0, -1.0)

    def __init__(self, policy: Policy) -> None:
        self.policy, self.mode, self.crop = policy, policy.mode, policy.crop

    def decide(self, seen: Observation, situation: Situation) -> Decision:
        """The mean of the eight decisions."""
        decision = self.policy.decide(seen, situation)
        if decision.counts is None:
            return decision
        every = [decision]
        for quarters, mirror in itertools.islice(itertools.product(range(4), (False, True)), 1, 8):
            shown = turned(seen, quarters)
            other = self.policy.decide(mirrored(shown) if mirror else shown, situation)
            assert other.counts is not None
            counts = other.counts * torch.tensor(self.SIGNS) if mirror else other.counts
            every.append(replace(other, counts=turned_counts(counts, -quarters)))
        counts = torch.stack([one.counts for one in every if one.counts is not None]).mean(0)
        confidence = torch.stack([one.confidence for one in every]).mean(0)
        return replace(decision, counts=counts, confidence=confidence)


def turned_counts(counts: Tensor, quarters: int) -> Tensor:
    """The counts (B, 6) of a move in a picture that is turned as `turned` does."""
    for _ in range(quarters % 4):
        x, y, z, about_x, about_y, about_z = counts.unbind(-1)
        counts = torch.stack([y, -x, z, about_y, -about_x, about_z], -1)
    return counts


class OraclePolicy:
    """Knows the true poses: tests the loop exactly, without weights.

    `truth` (N) are centred poses of the loop's N targets.
    """

    def __init__(
        self, truth: Pose, mode: MoveMode = MoveMode.SINGLE, crop: Crop = "look_at"
    ) -> None:
        self.truth, self.mode, self.crop = truth.to(torch.float64), mode, crop

    def decide(self, seen: Observation, situation: Situation) -> Decision:
        """The expert's action, and the exact counts to the truth."""
        goal = self.truth[situation.target]
        counts = difference(situation.pose, goal, situation.sphere_diameter, self.crop)
        logits = functional.one_hot(expert_action(counts), 13).to(torch.float64)
        return Decision(logits, counts, torch.ones(len(counts)))


def load_policy(
    path: Path | None = None, mode: MoveMode | None = None, compute: Compute = "auto"
) -> NetworkPolicy:
    """A policy from a weights file; without one, from the weights that are shipped.

    `compute` are the numbers of its convolutions: `auto` takes bfloat16 where the processor has
    AMX instructions, which is faster and moves poses by hundredths of a count; with `float32` they
    are what they are on machines without.
    """
    loaded = load_network(SHIPPED_WEIGHTS if path is None else Path(path))
    name = "shipped multi-object model" if path is None else Path(path).name
    source = f"{name} (sha256 {loaded.sha256[:12]})"
    return NetworkPolicy(loaded.network, mode, source, compute)
