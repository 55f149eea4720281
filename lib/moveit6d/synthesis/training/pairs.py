"""Training pairs: a start pose's rendering beside an observed patch whose true pose is known.

Never trains. A pair lives in one look-at view, that of the start pose, so that all it needs is an
orientation, a distance in diameters and the pose delta to the truth. (For comparison also in
an axis-parallel view; there it matters in which direction the object stands.)
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields

import numpy as np
import torch
from torch import Tensor
from torch.nn import functional

from ...actions import PoseAction, pose_delta
from ...geometry.crop import PATCH_SIZE, Crop, crop_patches, view_of
from ...geometry.mesh import Mesh, sphere_diameters
from ...geometry.pose import Pose
from ...geometry.rotation import random_rotations
from ...observation import Observation
from ...rendering.embree import EmbreeRenderer
from ...rendering.renderer import GBuffer
from ...rendering.shading import shade_plain
from ..augmentation.augment import AugmentConfig, RandomSource
from ..augmentation.composing import Composer
from ..augmentation.hands import HandConfig
from ..augmentation.lighting import LightConfig
from ..augmentation.occluder_bank import BankConfig
from .clusters import ClusterConfig, draw_delta
from .equivalents import nearest_delta


@dataclass(frozen=True)
class PairConfig:
    """All that is random about a pair."""

    clusters: ClusterConfig = field(default_factory=ClusterConfig)
    lights: LightConfig = field(default_factory=LightConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    hands: HandConfig = field(default_factory=HandConfig)
    bank: BankConfig = field(default_factory=BankConfig)
    distance: tuple[float, float] = (2.2, 14.0)  # of the object in diameters, log-uniform
    crop: Crop = "look_at"
    off_axis: float = 0.45  # tangent up to which objects stand beside the axis, if axis-parallel
    zoomed: float = 0.0  # share of pairs of which the patch shows only the middle of the object …
    zoom: tuple[float, float] = (1.1, 2.0)  # … so many times larger; all deltas are larger, too
    # What a policy may move at once, and how far off it may lead, in training on its own states.
    farthest: tuple[float, ...] = (35.0, 35.0, 20.0, 25.0, 25.0, 25.0)
    texture_gain: float = 0.2  # how far the mesh's colours may be from the object's, a channel
    texture_wave: float = 0.0  # the same, changing smoothly over the rendering


@dataclass(frozen=True)
class TrainingBatch:
    """Observations and the truth about them, B pairs.

    `delta` (B, 6) takes the start to the truth, or to the nearest pose that looks the same if the
    object declares symmetries; `true_depth` (B, 1, 128, 128) is the true pose's
    depth as in `Observation.depth`, `true_mask` (B, 1, 128, 128) its silhouette and `visible`
    (B, 1, 128, 128) what of that is not occluded; `clear` (B, 1, 128, 128) is 1 where nothing
    would occlude the object; `mesh` (B,) is the index of the object, `zoom` (B,) how many times
    larger than usual the patch shows it (delta, distance and depths are in diameters divided by
    that),
    `rotation` (B, 3, 3) the start's in its view and `direction` (B, 2) x / z and y / z of its
    centre there, 0 in a look-at view.
    """

    observation: Observation
    delta: Tensor
    true_depth: Tensor
    true_mask: Tensor
    visible: Tensor
    clear: Tensor
    mesh: Tensor
    zoom: Tensor
    rotation: Tensor
    direction: Tensor

    def to(self, device: torch.device) -> TrainingBatch:
        """The same pairs on another device."""
        return TrainingBatch(*(getattr(self, item.name).to(device) for item in fields(self)))


class PairGenerator:
    """Draws batches of pairs from meshes and photos; the same seed gives the same pairs."""

    def __init__(
        self, meshes: list[Mesh], photos: list[np.ndarray], config: PairConfig, seed: int,
        occluders: list[Mesh] | None = None,
    ) -> None:  # fmt: skip
        """`occluders` fill the bank, if there is one; the same meshes unless others are given."""
        self.meshes, self.config = meshes, config
        self.random = np.random.default_rng(seed)
        self.generator = torch.Generator().manual_seed(int(self.random.integers(2**62)))
        self.renderer = EmbreeRenderer()
        self.rng = RandomSource(self.generator)
        self.composer = Composer(photos, config.augment, config.lights, self.random, self.rng)
        self.composer.use_bank(config.bank, occluders or meshes, self.renderer, config.distance)
        self.composer.use_hands(config.hands, self.renderer)

    def batch(self, size: int, cluster: str | None = None) -> TrainingBatch:
        """`size` new pairs, of one named cluster if given."""
        index = self.random.integers(len(self.meshes), size=size)
        delta = np.stack([draw_delta(self.random, self.config.clusters, cluster) for _ in index])
        return self.compose(torch.from_numpy(index), torch.from_numpy(delta))

    def compose(self, index: Tensor, delta: Tensor) -> TrainingBatch:
        """Pairs of the given meshes (B,) whose truth lies a `delta` (B, 6) away from the start."""
        meshes = [self.meshes[int(i)] for i in index]
        zoom = self._zoom(len(meshes))
        diameter = sphere_diameters(meshes) / zoom
        low, high = np.log(self.config.distance)
        distance = torch.from_numpy(np.exp(self.random.uniform(low, high, len(meshes)))) * zoom
        rotation = random_rotations(len(meshes), self.generator)
        direction = self._directions(len(meshes))
        crop = self.config.crop
        start = Pose(rotation, _place(direction, distance * diameter))
        truth = PoseAction.from_delta(delta).apply_centred(start, diameter, crop)
        delta = nearest_delta(meshes, start, truth, diameter, crop)
        intrinsics = view_of(start, diameter, crop).intrinsics
        rendered = self.renderer.render(meshes, start, intrinsics)
        observed = self.renderer.render(meshes, truth, intrinsics)
        relative, true_depth = (
            _relative(buffer, distance, diameter) for buffer in (rendered, observed)
        )
        picture, clear = self.composer.picture(observed, true_depth, distance.float())
        rendering = self._rendering(rendered)
        observation = Observation(picture, rendering, relative, rendered.mask, distance.float())
        return TrainingBatch(
            observation, delta.float(), true_depth, observed.mask, observed.mask * clear, clear,
            index, zoom, rotation, direction.float(),
        )  # fmt: skip

    def advance(self, batch: TrainingBatch, moves: Tensor) -> TrainingBatch:
        """The same pictures as they look after a policy's moves (B, 6), with new renderings.

        So that a network is trained on the states that it leads to. A move that would
        lose the object, or that leads farther away than `farthest`, is not made.
        """
        meshes = [self.meshes[int(i)] for i in batch.mesh]
        diameter = sphere_diameters(meshes) / batch.zoom
        depth = batch.observation.distance.double() * diameter
        start = Pose(batch.rotation, _place(batch.direction.double(), depth))
        crop = self.config.crop
        truth = PoseAction.from_delta(batch.delta.double()).apply_centred(start, diameter, crop)
        moves = self._sensible(moves.double(), start, truth, diameter)
        moved = PoseAction.from_delta(moves).apply_centred(start, diameter, crop)
        old, view = (view_of(pose, diameter, crop) for pose in (start, moved))
        here, goal = view.to_virtual(moved), view.to_virtual(truth)
        distance = view.distance / diameter
        rendered = self.renderer.render(meshes, here, view.intrinsics)
        observed = self.renderer.render(meshes, goal, view.intrinsics)
        layers = torch.cat([batch.observation.image, batch.clear], 1)
        layers = crop_patches(layers, view, old.intrinsics)
        clear = (layers[:, 3:] > 0.5).float()
        relative, true_depth = (
            _relative(buffer, distance, diameter) for buffer in (rendered, observed)
        )
        observation = Observation(
            layers[:, :3], self._rendering(rendered), relative, rendered.mask, distance.float()
        )
        return TrainingBatch(
            observation, nearest_delta(meshes, here, goal, diameter, crop).float(), true_depth,
            observed.mask, observed.mask * clear, clear, batch.mesh, batch.zoom,
            here.rotation, (here.translation[:, :2] / here.translation[:, 2:]).float(),
        )  # fmt: skip

    def _directions(self, number: int) -> Tensor:
        """x / z and y / z of so many objects' centres: (B, 2)."""
        if self.config.crop == "look_at":
            return torch.zeros(number, 2, dtype=torch.float64)
        reach = self.config.off_axis
        return torch.from_numpy(self.random.uniform(-reach, reach, (number, 2)))

    def _zoom(self, number: int) -> Tensor:
        """How many times larger than usual each of so many patches shows its object: (B,)."""
        if not self.config.zoomed:
            return torch.ones(number, dtype=torch.float64)
        low, high = np.log(self.config.zoom)
        larger = np.exp(self.random.uniform(low, high, number))
        chosen = self.random.random(number) < self.config.zoomed
        return torch.from_numpy(np.where(chosen, larger, 1.0))

    def _sensible(self, moves: Tensor, start: Pose, truth: Pose, diameter: Tensor) -> Tensor:
        """The moves (B, 6), zero where they would lose the object."""
        far = torch.tensor(self.config.farthest, dtype=torch.float64)
        moves = moves.clamp(-far, far)
        crop = self.config.crop
        moved = PoseAction.from_delta(moves).apply_centred(start, diameter, crop)
        left = pose_delta(moved, truth, diameter, crop).abs()
        keep = (left <= far).all(-1) & (moved.translation[:, 2] > 1.5 * diameter)
        return moves * keep[:, None]

    def _rendering(self, rendered: GBuffer) -> Tensor:
        """The start's rendering (B, 3, 128, 128) in colours that are not quite the object's."""
        batch, rng = len(rendered.mask), self.rng
        gain = rng.uniform(batch, 3, 1, 1, between=(-1.0, 1.0)) * self.config.texture_gain
        if self.config.texture_wave > 0:
            coarse = rng.uniform(batch, 3, 4, 4, between=(-1.0, 1.0)) * self.config.texture_wave
            gain = gain + functional.interpolate(
                coarse, (PATCH_SIZE, PATCH_SIZE), mode="bilinear", align_corners=True
            )
        return (shade_plain(rendered) * (1 + gain)).clamp(0, 1)


def _place(direction: Tensor, depth: Tensor) -> Tensor:
    """Points (B, 3) in a direction (B, 2), x / z and y / z, at a depth (B,)."""
    return torch.cat([direction, torch.ones_like(depth)[:, None]], 1) * depth[:, None]


def _relative(buffer: GBuffer, distance: Tensor, diameter: Tensor) -> Tensor:
    """Depth behind the object's centre in diameters, 0 outside the object."""
    depth = buffer.depth / diameter.float()[:, None, None, None]
    return (depth - distance.float()[:, None, None, None]) * buffer.mask
