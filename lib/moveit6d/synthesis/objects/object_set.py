"""The objects that pairs are drawn of: a list of meshes on the CPU, or a bank of them on a GPU.

Never shades and never draws a pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...geometry.mesh import Mesh, sphere_diameters
from ...geometry.pose import Pose
from ...rendering.cuda_renderer import BankRenderer
from ...rendering.embree import EmbreeRenderer
from ...rendering.renderer import GBuffer


class ObjectSet(Protocol):
    """Numbered objects that can be rendered in batches; poses are of centred frames."""

    @property
    def device(self) -> torch.device:
        """Where renderings lie."""

    def __len__(self) -> int:
        """How many different ones `draw` can give."""

    def draw(self, random: np.random.Generator, count: int) -> Tensor:
        """Numbers (count,) of random objects, on the CPU."""

    def diameters(self, index: Tensor) -> Tensor:
        """Of the bounding spheres, metres, float64: (B,)."""

    def symmetries(self, number: int) -> NDArray[np.float64]:
        """Motions (S, 4, 4) of the centred frame that leave an object as it looks."""

    def render(self, index: Tensor, poses: Pose, intrinsics: Tensor) -> GBuffer:
        """A patch for each of the objects (B,)."""


class MeshObjects:
    """Meshes rendered one after another on the CPU."""

    def __init__(self, meshes: Sequence[Mesh]) -> None:
        self.meshes = meshes
        self.renderer = EmbreeRenderer()
        self.device = torch.device("cpu")

    def __len__(self) -> int:
        return len(self.meshes)

    def draw(self, random: np.random.Generator, count: int) -> Tensor:
        """Each mesh is as likely."""
        return torch.from_numpy(random.integers(len(self.meshes), size=count))

    def diameters(self, index: Tensor) -> Tensor:
        """See `ObjectSet`."""
        return sphere_diameters(self._chosen(index))

    def symmetries(self, number: int) -> NDArray[np.float64]:
        """See `ObjectSet`."""
        return self.meshes[number].motions

    def render(self, index: Tensor, poses: Pose, intrinsics: Tensor) -> GBuffer:
        """See `ObjectSet`."""
        return self.renderer.render(self._chosen(index), poses, intrinsics)

    def _chosen(self, index: Tensor) -> list[Mesh]:
        return [self.meshes[number] for number in index.tolist()]


class BankObjects:
    """Slots of a bank, rendered all at once; each of the `groups` is drawn by its share."""

    def __init__(
        self, renderer: BankRenderer, groups: Sequence[Sequence[int]], shares: Sequence[float]
    ) -> None:
        self.renderer, self.bank = renderer, renderer.bank
        self.groups = [np.asarray(group) for group in groups]
        self.shares = np.asarray(shares) / np.sum(shares)
        self.device = self.bank.device

    def __len__(self) -> int:
        return sum(map(len, self.groups))

    def draw(self, random: np.random.Generator, count: int) -> Tensor:
        """A group by its share, then each of its objects as likely."""
        group = random.choice(len(self.groups), size=count, p=self.shares)
        place = random.random(count)
        chosen = [self.groups[g][int(p * len(self.groups[g]))]
                  for g, p in zip(group, place, strict=True)]  # fmt: skip
        return torch.as_tensor(np.array(chosen, np.int64))

    def diameters(self, index: Tensor) -> Tensor:
        """See `ObjectSet`."""
        return self.bank.diameter[index.to(self.device)]

    def symmetries(self, number: int) -> NDArray[np.float64]:
        """See `ObjectSet`."""
        return self.bank.symmetries[number]

    def render(self, index: Tensor, poses: Pose, intrinsics: Tensor) -> GBuffer:
        """See `ObjectSet`."""
        return self.renderer.render(index.to(self.device), poses, intrinsics)
