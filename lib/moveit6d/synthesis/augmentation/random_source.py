"""Random numbers of one torch generator, on its device, in the forms that augmentation needs.

Never draws from any global generator.
"""

from __future__ import annotations

import numpy as np
import torch
from torch import Tensor

from ...typing import Range


class RandomSource:
    """Random tensors of one generator, and single numbers that no device is waited for."""

    def __init__(self, generator: torch.Generator) -> None:
        self.generator, self.device = generator, generator.device
        self.host = np.random.default_rng(generator.initial_seed())

    def uniform(self, *shape: int, between: Range = (0.0, 1.0)) -> Tensor:
        """Uniform numbers of the given shape."""
        values = torch.rand(*shape, generator=self.generator, device=self.device)
        return values * (between[1] - between[0]) + between[0]

    def normal(self, *shape: int) -> Tensor:
        """Standard normal numbers of the given shape."""
        return torch.randn(*shape, generator=self.generator, device=self.device)

    def bernoulli(self, count: int, probability: float) -> Tensor:
        """Which of `count` it happens to: bool (count,)."""
        return self.uniform(count) < probability

    def chosen(self, count: int, probability: float) -> Tensor:
        """The indices (n,) of those of `count` that it happens to."""
        return self.bernoulli(count, probability).nonzero()[:, 0]

    def scalar(self, between: Range = (0.0, 1.0)) -> float:
        """One uniform number on the CPU: no device is waited for."""
        return float(self.host.uniform(*between))

    def integers(self, *shape: int, below: int, start: int = 0) -> Tensor:
        """Whole numbers from `start` to `below` − 1 of the given shape."""
        return torch.randint(start, below, shape, generator=self.generator, device=self.device)

    def arange(self, count: int) -> Tensor:
        """0, 1, … `count` − 1 as floats."""
        return torch.arange(count, device=self.device, dtype=torch.float32)

    def permutation(self, count: int) -> Tensor:
        """A random order of `count` things."""
        return torch.randperm(count, generator=self.generator, device=self.device)
