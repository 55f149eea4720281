"""Observations out of noise, for tests of networks."""

import torch

from moveit6d.observation import Observation


def an_observation(batch: int, seed: int = 0) -> Observation:
    """A batch of plausible random patches."""
    generator = torch.Generator().manual_seed(seed)

    def noise(channels: int) -> torch.Tensor:
        return torch.rand(batch, channels, 128, 128, generator=generator)

    mask = (noise(1) > 0.3).float()
    depth = (noise(1) - 0.5) * 0.5 * mask
    distance = torch.rand(batch, generator=generator) * 8 + 3
    return Observation(noise(3), noise(3) * mask, depth, mask, distance)
