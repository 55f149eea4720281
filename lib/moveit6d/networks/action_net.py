"""The paper's network: concatenated patches → attention-weighted embedding → 13 actions.

Never renders and never applies a pose delta. Paper, section "Method" and its architecture figure.
The paper draws the layers without their sizes; those here are ours.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from ..geometry.crop import Crop
from ..observation import GREY, Observation
from .blocks import Residual, attention_pool, conv_block
from .policy_output import PolicyOutput


@dataclass(frozen=True)
class ActionConfig:
    """Sizes of an `ActionNet`."""

    channels: tuple[int, int, int, int] = (32, 64, 96, 128)  # strides 2, 4, 8, 16
    hidden: int = 128
    use_depth: bool = True
    crop: Crop = "look_at"  # the kind of patches that it is trained on


class ActionNet(nn.Module):
    """Observation (8 channels, 7 without depth) → logits of the 13 actions."""

    def __init__(self, config: ActionConfig | None = None) -> None:
        super().__init__()
        self.config = config = config or ActionConfig()
        c2, c4, c8, c16 = config.channels
        self.embed = nn.Sequential(
            conv_block(8 if config.use_depth else 7, c2, 2, 5),
            conv_block(c2, c4, 2),
            Residual(c4),
            conv_block(c4, c8, 2),
            Residual(c8),
            conv_block(c8, c16, 2),
            Residual(c16),
        )
        self.attend = nn.Conv2d(c16, 1, 1)
        self.classifier = nn.Sequential(
            nn.Linear(c16, config.hidden), nn.ReLU(inplace=True), nn.Linear(config.hidden, 14)
        )

    def forward(self, observation: Observation) -> tuple[PolicyOutput, Tensor]:
        """The prediction, and the confidence's logit (B,) for training.

        The logit's gradient reaches the confidence's own weights alone, those of output 13: the
        actions are learnt as if there were none.
        """
        channels = observation.channels(self.config.use_depth) - GREY
        features = self.embed(channels.contiguous(memory_format=torch.channels_last))
        attention = torch.sigmoid(self.attend(features))
        first, relu, last = self.classifier
        hidden = relu(first(attention_pool(features, attention)))
        logits, confidence = last(hidden)[:, :13], last(hidden.detach())[:, 13]
        return PolicyOutput(logits, None, torch.sigmoid(confidence), attention), confidence
