"""Policies predict the next pose delta: a network, or an oracle that knows the true pose.

Never renders and never applies a pose delta.
"""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Protocol, runtime_checkable
from weakref import WeakValueDictionary

import torch
from torch import Tensor
from torch.nn import functional

from .actions import PoseAction, expert_action, mirror_delta, pose_delta, rotate_delta
from .config import ActionMode, Mode
from .errors import InputError
from .geometry.crop import Crop
from .geometry.pose import Pose
from .networks.action_net import ActionNet
from .networks.compact import CompactCorrelationNet
from .networks.inference import Compute, InferenceNetwork
from .networks.kinds import PoseNet
from .networks.policy_output import PolicyOutput
from .networks.weights_file import load_network
from .observation import Observation, mirrored, rotated

BATCH_SIZE = 32  # crops a pass of a network: larger batches are hardly faster and cost memory
SHIPPED_WEIGHTS = Path(__file__).parent / "weights" / "multi_object.safetensors"


@dataclass(frozen=True, eq=False)
class LoopState:
    """Where the loop stands: for policies that know more than what is seen.

    `pose` (B) is centred, object → camera; `sphere_diameter` (B,) in metres; `target` (B,) says
    which of the caller's targets each row is for: several rows may be starts for one of them, and
    others may have no row.
    """

    pose: Pose
    sphere_diameter: Tensor
    target: Tensor


class Policy(Protocol):
    """Predicts from observations; `mode` says how its predictions are carried out.

    `crop` is the kind of patches that it wants to see, and in which its delta is measured.
    """

    mode: ActionMode
    crop: Crop

    def predict(self, observation: Observation, state: LoopState) -> PolicyOutput:
        """A prediction for each observation of the batch."""
        ...


def mode_of(policy: Policy, mode: Mode | None) -> ActionMode:
    """The mode that a configuration asks for, or else the policy's own."""
    return policy.mode if mode is None else ActionMode(mode)


@runtime_checkable
class DescriptorPolicy(Policy, Protocol):
    """A policy that also says what places in images look like: what detection searches with."""

    def descriptors(self, images: Tensor) -> Tensor:
        """A descriptor for each cell of 8 × 8 pixels: (B, 3, H, W) in [0, 1] → (B, C, h, w)."""
        ...


def to_action(
    prediction: PolicyOutput, mode: ActionMode, step_size: float = 1.0, stop_delta: float = 0.5
) -> PoseAction:
    """The update that a prediction stands for.

    In mode `single` the action with the highest score, `step_size` units long. In mode `all_axes`
    the delta as it is; it also stops if the stop action scores highest or every axis is under
    `stop_delta` steps, and the remainder is applied as the last update.
    """
    best = prediction.logits.argmax(-1)
    if mode is ActionMode.SINGLE:
        return PoseAction.from_index(best, step_size)
    if prediction.delta is None:
        raise InputError("This network only chooses single actions: use the mode 'single' with it.")
    done = prediction.delta.abs().amax(-1) < stop_delta * step_size
    return PoseAction(prediction.delta.to(torch.float64), (best == 12) | done)


def search_policy(policy: DescriptorPolicy) -> DescriptorPolicy:
    """The policy with the confidence that it has for searches, if it has one."""
    return policy.for_search if isinstance(policy, NetworkPolicy) else policy


class NetworkPolicy:
    """Predicts with a trained network, in evaluation mode, without gradients."""

    def __init__(
        self,
        network: PoseNet,
        source: str = "",
        compute: Compute = "auto",
        device: str | torch.device = "cpu",
    ) -> None:
        self.network = InferenceNetwork(network, compute, device)
        single = isinstance(network, ActionNet)
        self.crop: Crop = network.config.crop
        self.mode = ActionMode.SINGLE if single else ActionMode.ALL_AXES
        self.source = source  # what the weights are, for reports
        self._given, self._compute, self._device = network, compute, device

    @cached_property  # what never searches does not make it
    def for_search(self) -> NetworkPolicy:
        """The same network; where it has a confidence of its own for searches, with that."""
        network = self._given
        if not isinstance(network, CompactCorrelationNet) or not network.config.search_head:
            return self
        return NetworkPolicy(network.for_search(), self.source, self._compute, self._device)

    @property
    def takes_larger_crops(self) -> bool:
        """Whether the network answers crops of more pixels than it was trained with as well."""
        return isinstance(self._given, CompactCorrelationNet)

    def predict(self, observation: Observation, state: LoopState) -> PolicyOutput:
        """One pass of the network."""
        return self.network(observation)

    def descriptors(self, images: Tensor) -> Tensor:
        """What each cell of 8 × 8 pixels looks like: images (B, 3, H, W) → (B, C, H / 8, W / 8)."""
        return self.network.descriptors(images)


class DihedralAugmentation:
    """Test-time augmentation: the mean prediction over the eight dihedral views of an observation.

    Four quarter turns, each of them also mirrored: the errors of another policy differ between
    them. Scores of single actions and the attention are those of what is seen.
    """

    def __init__(self, policy: Policy) -> None:
        self.policy, self.mode, self.crop = policy, policy.mode, policy.crop

    def predict(self, observation: Observation, state: LoopState) -> PolicyOutput:
        """The mean of the eight predictions."""
        prediction = self.policy.predict(observation, state)
        if prediction.delta is None:
            return prediction
        every = [prediction]
        for quarters, mirror in itertools.islice(itertools.product(range(4), (False, True)), 1, 8):
            shown = rotated(observation, quarters)
            other = self.policy.predict(mirrored(shown) if mirror else shown, state)
            assert other.delta is not None
            delta = mirror_delta(other.delta) if mirror else other.delta
            every.append(replace(other, delta=rotate_delta(delta, -quarters)))
        delta = torch.stack([one.delta for one in every if one.delta is not None]).mean(0)
        confidence = torch.stack([one.confidence for one in every]).mean(0)
        return replace(prediction, delta=delta, confidence=confidence)


class OraclePolicy:
    """Knows the true poses: tests the loop exactly, without weights.

    `truth` (N) are centred poses of the loop's N targets.
    """

    def __init__(
        self, truth: Pose, mode: ActionMode = ActionMode.SINGLE, crop: Crop = "look_at"
    ) -> None:
        if not isinstance(truth, Pose) or len(truth.batch_shape) != 1:
            raise InputError(
                "OraclePolicy: truth must be a batch of poses, one a target: Pose.stack([pose])."
            )
        self.truth, self.mode, self.crop = truth.detach().to(torch.float64), mode, crop

    def predict(self, observation: Observation, state: LoopState) -> PolicyOutput:
        """The expert's action, and the exact delta to the truth."""
        goal = self.truth[state.target]
        delta = pose_delta(state.pose, goal, state.sphere_diameter, self.crop)
        logits = functional.one_hot(expert_action(delta), 13).to(torch.float64)
        return PolicyOutput(logits, delta, torch.ones(len(delta)))


def load_policy(
    path: str | Path | None = None,
    *,
    compute: Compute = "auto",
    device: str | torch.device = "cpu",
) -> NetworkPolicy:
    """A policy from a weights file; without one, from the weights that are shipped.

    `device` is where the network runs, for example "cuda"; crops and poses stay on the CPU.

    `compute` are the numbers of its convolutions: `auto` takes bfloat16 where the processor has
    AMX instructions, which is faster and changes poses by hundredths of a unit; with `float32` they
    are what they are on machines without. `InputError` for other numbers, and for a device that
    this machine does not have.

    >>> load_policy().mode.value
    'all_axes'
    """
    loaded = load_network(SHIPPED_WEIGHTS if path is None else Path(path))
    name = "shipped multi-object model" if path is None else Path(path).name
    source = f"{name} (sha256 {loaded.sha256[:12]})"
    policy = NetworkPolicy(loaded.network, source, compute, device)
    # Policies of the same weights share what their network traces and packs.
    key = (loaded.sha256, policy.network.is_bfloat16, str(device))
    policy.network = _SHARED.setdefault(key, policy.network)
    return policy


_SHARED: WeakValueDictionary[tuple[str, bool, str], InferenceNetwork] = WeakValueDictionary()
