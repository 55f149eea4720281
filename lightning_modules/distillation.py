"""A trained network's encoder as the teacher of another one's.

Never trains and never draws data. The teacher's features are what many hours of matching taught; a
smaller encoder learns to have them in a part of that.
"""

from __future__ import annotations

from pathlib import Path

import torch
from torch import Tensor
from torch.nn import functional

from moveit6d.errors import InputError
from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.kinds import MatchingNet, PoseNet
from moveit6d.networks.matching import centred, encoder_pictures
from moveit6d.networks.weights_file import load_network
from moveit6d.observation import Observation

Features = tuple[Tensor, Tensor]  # of image and rendering (2 B, C, …) at strides 4 and 8


class Teacher:
    """The encoder in a weights file.

    Args:
        path: weights file of a network with an encoder.
        student: the network that is to learn from it; `InputError` if it cannot.
    """

    def __init__(self, path: Path, student: PoseNet) -> None:
        if not path.is_file():
            raise InputError(
                f"model.teacher: {path} does not exist; give the path of a weights file (that of "
                "configs/fit/compact.yaml is in the project's repository), or null: nobody."
            )
        self.path, network = path, load_network(path).network
        if not isinstance(student, CompactCorrelationNet) or isinstance(network, ActionNet):
            raise InputError("model.teacher: only a compact network learns from an encoder.")
        sizes = network.config.channels
        if sizes[1:] != student.config.channels[1:]:
            raise InputError(
                f"model.teacher: the encoder in {path} has {sizes[1:]} channels at strides 4 and "
                f"8, the network in training {student.config.channels[1:]}."
            )
        self.network: MatchingNet = network.requires_grad_(False)

    @torch.no_grad()
    def features(self, observation: Observation) -> Features:
        """What the encoder says of a batch."""
        pictures = encoder_pictures(observation)
        network = self.network.to(pictures.device)
        four = network.encode4(pictures)
        return four, network.encode8(four)


def distillation_loss(student: Features, teacher: Features) -> Tensor:
    """How far features are from the teacher's: 0 for the same, about 2 for unrelated ones.

    At stride 4 the squared error against the teacher's variance; at stride 8, where only directions
    are compared (`matching`), one minus the cosine.
    """
    fours, eights = (
        (one.float(), other.float()) for one, other in zip(student, teacher, strict=True)
    )
    error = (fours[0] - fours[1]).square().mean() / fours[1].var().clamp_min(1e-6)
    cosine = functional.cosine_similarity(centred(eights[0]), centred(eights[1]), dim=1)
    return error + 1 - cosine.mean()
