"""Layers that the networks share.

Never a whole network.
"""

from __future__ import annotations

import torch
from torch import Tensor, nn


def conv_block(inputs: int, outputs: int, stride: int = 1, kernel: int = 3) -> nn.Sequential:
    """Convolution, batch normalisation, ReLU: (B, inputs, H, W) → (B, outputs, H/s, W/s)."""
    convolution = nn.Conv2d(inputs, outputs, kernel, stride, kernel // 2, bias=False)
    return nn.Sequential(convolution, nn.BatchNorm2d(outputs), nn.ReLU(inplace=True))


class Residual(nn.Module):
    """Two convolutions around an identity: (B, C, H, W) → (B, C, H, W)."""

    def __init__(self, channels: int) -> None:
        super().__init__()
        self.first = conv_block(channels, channels)
        self.second = nn.Sequential(
            nn.Conv2d(channels, channels, 3, 1, 1, bias=False), nn.BatchNorm2d(channels)
        )

    def forward(self, features: Tensor) -> Tensor:
        """Add the block's answer to its input."""
        return torch.relu(features + self.second(self.first(features)))


def attention_pool(features: Tensor, attention: Tensor) -> Tensor:
    """Weighted global average: features (B, C, h, w), attention (B, 1, h, w) ≥ 0 → (B, C).

    The paper's attention map "multiplied in" followed by global average pooling.
    """
    weight = attention.flatten(2).sum(-1) + 1e-3
    return (features * attention).flatten(2).sum(-1) / weight
