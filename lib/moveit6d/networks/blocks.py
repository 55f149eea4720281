"""Layers that the networks share.

Never a whole network.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Sequence

import torch
from torch import Tensor, nn


def conv_block(inputs: int, outputs: int, stride: int = 1, kernel: int = 3) -> nn.Sequential:
    """Convolution, batch normalisation, ReLU: (B, inputs, H, W) → (B, outputs, H/s, W/s)."""
    convolution = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class Residual(nn.Module):
    """Two convolutions around an identity: (B, C, H, W) → (B, C, H, W).

    With `identity` it begins as one: it answers with its input, which must not be negative.
    """

    def __init__(self, channels: int, identity: bool = False) -> None:
        super().__init__()
        self.first = conv_block(channels, channels)
        norm = nn.BatchNorm2d(channels)
        self.second = nn.Sequential(nn.Conv2d(channels, channels, 3, 1, 1, bias=False), norm)
        if identity:
            nn.init.zeros_(norm.weight)

    def forward(self, features: Tensor) -> Tensor:
        """Add the block's answer to its input."""
        return torch.relu(features + self.second(self.first(features)))


def with_extra_blocks(
    before: Sequence[nn.Module], channels: int, number: int, after: Sequence[nn.Module] = ()
) -> nn.Sequential:
    """Modules in sequence with `number` residual blocks put in between that begin as identities.

    Those before must end in a ReLU. The names of the others do not depend on `number`, so that a
    network can begin with the weights of a shallower one and its answers.
    """
    blocks = nn.Sequential(*[Residual(channels, identity=True) for _ in range(number)])
    parts = [(str(i), module) for i, module in enumerate([*before, *after])]
    if number:
        parts.insert(len(before), ("extra_blocks", blocks))
    return nn.Sequential(OrderedDict(parts))


def attention_pool(features: Tensor, attention: Tensor) -> Tensor:
    """Weighted global average: features (B, C, h, w), attention (B, 1, h, w) ≥ 0 → (B, C).

    The paper's attention map "multiplied in" followed by global average pooling.
    """
    weight = attention.flatten(2).sum(-1) + 1e-3
    return (features * attention).flatten(2).sum(-1) / weight
