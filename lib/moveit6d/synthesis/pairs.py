"""Training pairs: a start pose's rendering beside an observed patch whose true pose is known.

Never trains. A pair lives in one look-at view, that of the start pose, so that all it needs is an
orientation, a distance in diameters and the counts to the truth. METHOD 8.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
import torch
from torch import Tensor

from ..actions import PoseAction
from ..geometry.crop import OBJECT_SIZE, PATCH_SIZE
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.rotation import random_rotations
from ..observation import Observation
from ..rendering.embree import EmbreeRenderer
from ..rendering.renderer import GBuffer
from ..rendering.shading import shade_plain
from .augment import (
    AugmentConfig,
    Dice,
    blur,
    cut_border,
    degrade,
    occlude,
    paste,
    recolour,
    scatter,
)
from .clusters import ClusterConfig, draw_counts
from .lighting import LightConfig, light
from .photos import random_square


@dataclass(frozen=True)
class PairConfig:
    """All that is random about a pair."""

    clusters: ClusterConfig = field(default_factory=ClusterConfig)
    lights: LightConfig = field(default_factory=LightConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    distance: tuple[float, float] = (2.2, 14.0)  # of the object in diameters, log-uniform
    texture_gain: float = 0.15  # how far the mesh's colours may be from the object's, a channel


@dataclass(frozen=True)
class TrainingBatch:
    """Observations and the truth about them, B pairs.

    `counts` (B, 6) take the start to the truth; `true_depth` (B, 1, 128, 128) is the true pose's
    depth as in `Observation.depth`, `true_mask` (B, 1, 128, 128) its silhouette and `visible`
    (B, 1, 128, 128) what of that nothing covers; `mesh` (B,) is the index of the object.
    """

    observation: Observation
    counts: Tensor
    true_depth: Tensor
    true_mask: Tensor
    visible: Tensor
    mesh: Tensor

    def to(self, device: torch.device) -> TrainingBatch:
        """The same pairs on another device."""
        return TrainingBatch(*(getattr(self, item.name).to(device) for item in fields(self)))


class PairGenerator:
    """Draws batches of pairs from meshes and photos; the same seed gives the same pairs."""

    def __init__(
        self, meshes: list[Mesh], photos: list[np.ndarray], config: PairConfig, seed: int
    ) -> None:
        self.meshes, self.photos, self.config = meshes, photos, config
        self.random = np.random.default_rng(seed)
        self.generator = torch.Generator().manual_seed(int(self.random.integers(2**62)))
        self.renderer = EmbreeRenderer()

    def batch(self, size: int, cluster: str | None = None) -> TrainingBatch:
        """`size` new pairs, of one named cluster if given."""
        index = self.random.integers(len(self.meshes), size=size)
        counts = np.stack([draw_counts(self.random, self.config.clusters, cluster) for _ in index])
        return self.compose(torch.from_numpy(index), torch.from_numpy(counts))

    def compose(self, index: Tensor, counts: Tensor) -> TrainingBatch:
        """Pairs of the given meshes (B,) whose truth lies `counts` (B, 6) away from the start."""
        meshes = [self.meshes[int(i)] for i in index]
        diameter = torch.tensor([mesh.sphere_diameter for mesh in meshes], dtype=torch.float64)
        low, high = np.log(self.config.distance)
        distance = torch.from_numpy(np.exp(self.random.uniform(low, high, len(meshes))))
        rotation = random_rotations(len(meshes), self.generator)
        ahead = torch.zeros(len(meshes), 3, dtype=torch.float64)
        ahead[:, 2] = distance * diameter
        start = Pose(rotation, ahead)
        truth = PoseAction.of(counts).apply(start, diameter)
        intrinsics = _intrinsics(distance)
        rendered = self.renderer.render(meshes, start, intrinsics)
        observed = self.renderer.render(meshes, truth, intrinsics)
        return self._picture(index, counts, distance.float(), diameter.float(), rendered, observed)

    def _picture(
        self, index: Tensor, counts: Tensor, distance: Tensor, diameter: Tensor,
        rendered: GBuffer, observed: GBuffer,
    ) -> TrainingBatch:  # fmt: skip
        config, dice = self.config, Dice(self.generator)
        batch = len(index)
        relative, true_depth = (
            (buffer.depth / diameter[:, None, None, None] - distance[:, None, None, None])
            * buffer.mask
            for buffer in (rendered, observed)
        )
        lit = light(
            observed.albedo, observed.normal, true_depth, observed.mask, distance,
            config.lights, self.generator,
        )  # fmt: skip
        backgrounds, cuts = self._photos(batch), self._photos(batch)
        objects = torch.cat([lit * observed.mask, observed.mask], 1)
        picture = backgrounds
        behind = dice.chance(batch, config.augment.cluttered).nonzero()[:, 0]
        if len(behind):
            others = objects[dice.permutation(batch)][behind]
            placed = scatter(others, dice.uniform(len(behind), between=(0.4, 1.1)), 1.0, dice)
            picture[behind] = paste(
                picture[behind], placed[:, :3] / placed[:, 3:].clamp_min(1e-3), placed[:, 3:]
            )
        picture = paste(picture, *_soft_edge(lit, observed.mask))
        picture, covered = occlude(picture, objects, cuts, config.augment, dice)
        picture = blur(picture, config.augment, dice)
        picture = degrade(picture, config.augment, dice)
        picture = recolour(picture, config.augment, dice)
        picture, border = cut_border(picture.clamp(0, 1), config.augment, dice)
        visible = observed.mask * (covered < 0.5) * (1 - border)
        gain = 1 + dice.uniform(batch, 3, 1, 1, between=(-1.0, 1.0)) * config.texture_gain
        rendering = (shade_plain(rendered) * gain).clamp(0, 1)
        observation = Observation(
            (picture * 255).round() / 255, rendering, relative, rendered.mask, distance
        )
        return TrainingBatch(observation, counts.float(), true_depth, observed.mask, visible, index)

    def _photos(self, count: int) -> Tensor:
        squares = [random_square(self.photos, self.random, PATCH_SIZE) for _ in range(count)]
        return torch.from_numpy(np.stack(squares)).permute(0, 3, 1, 2).float() / 255


def _intrinsics(distance: Tensor) -> Tensor:
    matrix = torch.zeros(len(distance), 3, 3, dtype=torch.float64)
    matrix[:, 0, 0] = matrix[:, 1, 1] = OBJECT_SIZE * distance
    matrix[:, 0, 2] = matrix[:, 1, 2] = (PATCH_SIZE - 1) / 2
    matrix[:, 2, 2] = 1
    return matrix


def _soft_edge(lit: Tensor, mask: Tensor) -> tuple[Tensor, Tensor]:
    """The object with an edge about a pixel wide, as a camera's pixels would show it."""
    kernel = torch.tensor([0.25, 0.5, 0.25])
    weight = (kernel[:, None] * kernel[None]).expand(4, 1, 3, 3)
    both = torch.nn.functional.conv2d(torch.cat([lit * mask, mask], 1), weight, padding=1, groups=4)
    alpha = both[:, 3:]
    spread = both[:, :3] / alpha.clamp_min(1e-3)
    return torch.where(mask > 0.5, lit, spread), alpha
