"""Training pairs: a rendering at the start pose and an observed crop with a known true pose.

Never trains. A pair lives in the look-at view of its start pose, so that a rotation, a distance in
diameters and the pose delta to the truth describe it. (For comparison also in an axis-parallel
view, where the object's direction matters.) Everything is tensor arithmetic on the device of the
objects: a CPU, or a GPU that draws hundreds of pairs at once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, fields, replace

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...actions import PoseAction, pose_delta
from ...geometry.crop import Crop, crop_patches, view_of
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...geometry.rotation import random_rotations
from ...observation import Observation
from ...rendering.renderer import GBuffer
from ...typing import Range
from ..augmentation.composing import Composer
from ..augmentation.config import AugmentConfig
from ..augmentation.hands import HandConfig, HandSource, ProceduralHands
from ..augmentation.lights import LightConfig
from ..augmentation.occluder_bank import BankConfig
from ..augmentation.photo_bank import PhotoBank
from ..augmentation.random_source import RandomSource
from ..objects.object_set import MeshObjects, ObjectSet
from ..settings import check_settings
from .clusters import ClusterConfig, draw_deltas
from .equivalents import nearest_delta
from .texture_errors import TextureColourConfig, wrong_colours
from .views import ViewBatch, ViewConfig, draw_views


@dataclass(frozen=True)
class ZoomConfig:
    """Crops of the middle of the object, as in the loop's fine stage; the delta grows as well.

    Args:
        probability: of a zoomed crop.
        factor: how many times larger than usual.
    """

    probability: float = 0.0
    factor: Range = (1.1, 2.0)


@dataclass(frozen=True)
class FarRotationConfig:
    """Pairs with a rotation far beyond the clusters: they teach no pose delta (`TrainingBatch`).

    Args:
        probability: of such a rotation.
        angle: degrees, about a random axis.
    """

    probability: float = 0.0
    angle: Range = (35.0, 180.0)


@dataclass(frozen=True)
class PairConfig:
    """All that is random about a pair.

    Args:
        clusters: pose deltas from the start to the truth.
        lights: lights and materials.
        augment: what disturbs the observed crop.
        hands: hands and cards in front of the object.
        bank: the paper's bank of occluders.
        views: templates for the descriptors.
        distance: of the object in diameters, log-uniform.
        crop: look_at, or axis_parallel for a network whose config says so, too.
        max_off_axis: axis-parallel crops: largest x / z and y / z of an object's centre.
        zoom: crops of the middle of the object.
        max_delta: largest pose delta a policy makes at once, and largest remaining one that the
            pose losses use, for each of the six axes.
        texture_colour: errors of the rendering's colours.
        far_rotation: pairs with a rotation beyond the clusters.
        absent_probability: of an image that shows another object or none.
    """

    clusters: ClusterConfig = field(default_factory=ClusterConfig)
    lights: LightConfig = field(default_factory=LightConfig)
    augment: AugmentConfig = field(default_factory=AugmentConfig)
    hands: HandConfig = field(default_factory=HandConfig)
    bank: BankConfig = field(default_factory=BankConfig)
    views: ViewConfig = field(default_factory=ViewConfig)
    distance: Range = (2.2, 14.0)
    crop: Crop = "look_at"
    max_off_axis: float = 0.45
    zoom: ZoomConfig = field(default_factory=ZoomConfig)
    max_delta: tuple[float, ...] = (35.0, 35.0, 20.0, 25.0, 25.0, 25.0)
    texture_colour: TextureColourConfig = field(default_factory=TextureColourConfig)
    far_rotation: FarRotationConfig = field(default_factory=FarRotationConfig)
    absent_probability: float = 0.0

    def __post_init__(self) -> None:
        check_settings(self, "pairs")


@dataclass(frozen=True)
class TrainingBatch:
    """Observations and the truth about them, B pairs.

    `delta` (B, 6) takes the start to the truth, or to the nearest pose that looks the same if the
    object declares symmetries; `true_depth` (B, 1, 128, 128) is the true pose's depth as in
    `Observation.depth`, `true_mask` (B, 1, 128, 128) its silhouette and `clear` (B, 1, 128, 128)
    is 1 where nothing would occlude the object; `mesh` (B,) is the number of the object, on the
    CPU, `zoom` (B,) how many times larger than usual the crop shows it (delta, distance and depths
    are in diameters divided by that), `rotation` (B, 3, 3) the start's in its view and `direction`
    (B, 2) x / z and y / z of its centre there, 0 in a look-at view. `present` (B,) is 1 where the
    picture shows the object at all, `near` (B,) where it does and the truth is within
    `PairConfig.max_delta`. The others teach no pose delta: far ones the dense predictions and the
    confidence, absent ones visibility, weight and the confidence. `views` are templates for the
    descriptors, if any were drawn.
    """

    observation: Observation
    delta: Tensor
    true_depth: Tensor
    true_mask: Tensor
    clear: Tensor
    mesh: Tensor
    zoom: Tensor
    rotation: Tensor
    direction: Tensor
    present: Tensor
    near: Tensor
    views: ViewBatch | None = None

    @property
    def visible(self) -> Tensor:
        """What of the silhouette is not occluded: (B, 1, 128, 128)."""
        return self.true_mask * self.clear

    def to(self, device: torch.device) -> TrainingBatch:
        """The same pairs on another device; `mesh` stays where it is."""
        moved = {
            item.name: getattr(self, item.name).to(device)
            for item in fields(self)
            if item.name not in ("mesh", "views")
        }
        views = None if self.views is None else self.views.to(device)
        return TrainingBatch(mesh=self.mesh, views=views, **moved)

    def parts(self, count: int) -> Iterator[TrainingBatch]:
        """Every `count`-th pair, from the first, the second …: `count` batches.

        Views stay with their pairs, which are the first of each part as of the whole.
        """
        for first in range(count):
            chosen = slice(first, None, count)
            parts = {
                item.name: getattr(self, item.name)[chosen]
                for item in fields(self)
                if item.name not in ("observation", "views")
            }
            seen = Observation(
                *(getattr(self.observation, item.name)[chosen] for item in fields(Observation))
            )
            yield TrainingBatch(
                observation=seen, views=None if self.views is None else self.views[chosen], **parts
            )


class PairGenerator:
    """Draws batches of pairs of objects and photos; the same seed gives the same pairs."""

    def __init__(
        self, objects: list[Mesh] | ObjectSet, photos: list[np.ndarray] | PhotoBank,
        config: PairConfig, seed: int, occluders: list[Mesh] | ObjectSet | None = None,
        hands: HandSource | None = None,
    ) -> None:  # fmt: skip
        """`occluders` are put in front, from a bank if there is one; None: the objects."""
        self.objects = objects = _objects(objects)
        self.config, self.device = config, objects.device
        self.random = np.random.default_rng(seed)
        self.generator = torch.Generator(self.device)
        self.generator.manual_seed(int(self.random.integers(2**62)))
        self.rng = RandomSource(self.generator)
        pictures = photos if isinstance(photos, PhotoBank) else PhotoBank(photos, self.device)
        self.composer = Composer(pictures, config.augment, config.lights, self.rng)
        if occluders is not None or config.bank.size > 0:
            others = objects if occluders is None else _objects(occluders)
            self.composer.use_occluders(others, config.bank, config.distance, self.random)
        if config.hands.probability > 0:
            if hands is None:
                assert not isinstance(photos, PhotoBank), (
                    "procedural hands need photographs for their textures"
                )
                hands = ProceduralHands(config.hands, photos, self.random)
            self.composer.use_hands(config.hands, hands)

    def batch(self, size: int, cluster: str | None = None) -> TrainingBatch:
        """`size` new pairs, of one named cluster if given."""
        index = self.objects.draw(self.random, size)
        delta = draw_deltas(self.random, self.config.clusters, size, cluster)
        return self.compose(index, torch.from_numpy(self._with_far_rotations(delta)))

    def compose(self, index: Tensor, delta: Tensor) -> TrainingBatch:
        """Pairs of the given objects (B,) whose truth lies a `delta` (B, 6) away from the start."""
        batch, crop, device = len(index), self.config.crop, self.device
        zoom = self._zoom(batch).to(device)
        diameter = self.objects.diameters(index) / zoom
        low, high = np.log(self.config.distance)
        distance = torch.from_numpy(np.exp(self.random.uniform(low, high, batch))).to(device) * zoom
        rotation = random_rotations(batch, self.generator)
        direction = self._directions(batch).to(device)
        start = Pose(rotation, _place(direction, distance * diameter))
        truth = PoseAction.from_delta(delta.to(device)).apply_centred(start, diameter, crop)
        symmetries = self._symmetries(index)
        delta = nearest_delta(symmetries, start, truth, diameter, crop)
        view = view_of(start, diameter, crop)
        rendered = self.objects.render(index, start, view.intrinsics)
        observed, present = self._observed(index, truth, view.intrinsics)
        true_depth = _relative(observed, distance, diameter)
        picture, clear = self.composer.picture(observed, true_depth, distance.float(), index)
        pairs = self._pairs(
            picture, clear, rendered, observed.mask, true_depth, distance, diameter,
            mesh=index, zoom=zoom, rotation=rotation, direction=direction, delta=delta,
            present=present,
        )  # fmt: skip
        if not self.config.views.share:
            return pairs
        views = draw_views(pairs, view, truth, diameter, self.objects, self.config.views,
                           self.rng, self._rendering)  # fmt: skip
        return replace(pairs, views=views)

    def advance(self, batch: TrainingBatch, delta: Tensor) -> TrainingBatch:
        """The same images after a policy's pose deltas (B, 6), with new renderings.

        So a network is trained on the states that it leads to (docs/method.md). A delta that would
        lose the object, or lead from within `max_delta` of the truth to beyond it, is not applied.
        """
        diameter = self.objects.diameters(batch.mesh) / batch.zoom
        depth = batch.observation.distance.double() * diameter
        start = Pose(batch.rotation, _place(batch.direction.double(), depth))
        crop = self.config.crop
        truth = PoseAction.from_delta(batch.delta.double()).apply_centred(start, diameter, crop)
        applied = self._accepted(delta.double(), start, truth, diameter, batch.near)
        updated = PoseAction.from_delta(applied).apply_centred(start, diameter, crop)
        old, view = (view_of(pose, diameter, crop) for pose in (start, updated))
        here, goal = view.to_virtual(updated), view.to_virtual(truth)
        distance = view.distance / diameter
        rendered = self.objects.render(batch.mesh, here, view.intrinsics)
        observed = self.objects.render(batch.mesh, goal, view.intrinsics)
        layers = torch.cat([batch.observation.image, batch.clear], 1)
        layers = crop_patches(layers, view, old.intrinsics)
        return self._pairs(
            layers[:, :3], (layers[:, 3:] > 0.5).float(), rendered, observed.mask,
            _relative(observed, distance, diameter), distance, diameter,
            mesh=batch.mesh, zoom=batch.zoom, rotation=here.rotation,
            direction=here.translation[:, :2] / here.translation[:, 2:],
            delta=nearest_delta(self._symmetries(batch.mesh), here, goal, diameter, crop),
            present=batch.present,
        )  # fmt: skip

    def _pairs(
        self, image: Tensor, clear: Tensor, rendered: GBuffer, mask: Tensor, true_depth: Tensor,
        distance: Tensor, diameter: Tensor, *, mesh: Tensor, zoom: Tensor, rotation: Tensor,
        direction: Tensor, delta: Tensor, present: Tensor,
    ) -> TrainingBatch:  # fmt: skip
        """Pairs of images and the G-buffers at the start; `mask` is that at the truth."""
        observation = Observation(
            image,
            self._rendering(rendered),
            _relative(rendered, distance, diameter),
            rendered.mask,
            distance.float(),
        )
        return TrainingBatch(
            observation,
            delta.float(),
            true_depth,
            mask * present[:, None, None, None],
            clear,
            mesh,
            zoom,
            rotation,
            direction.float(),
            present,
            present * self._within(delta).float(),
        )

    def _symmetries(self, index: Tensor) -> Sequence[NDArray[np.float64]]:
        return [self.objects.symmetries(number) for number in index.tolist()]

    def _with_far_rotations(self, delta: NDArray[np.float64]) -> NDArray[np.float64]:
        """The deltas (B, 6), a part of them with a far rotation instead of theirs."""
        far = self.config.far_rotation
        if not far.probability:
            return delta
        number = len(delta)
        axis = self.random.normal(size=(number, 3))
        axis /= np.linalg.norm(axis, axis=1, keepdims=True)
        rotation = axis * self.random.uniform(*far.angle, (number, 1))
        chosen = self.random.random((number, 1)) < far.probability
        delta = delta.copy()
        delta[:, 3:] = np.where(chosen, rotation, delta[:, 3:])
        return delta

    def _observed(self, index: Tensor, truth: Pose, intrinsics: Tensor) -> tuple[GBuffer, Tensor]:
        """G-buffers at the true poses, and 1 where they show the object itself."""
        batch = len(index)
        absent = self.random.random(batch) < self.config.absent_probability
        present = torch.from_numpy(~absent).float().to(self.device)
        if not absent.any():
            return self.objects.render(index, truth, intrinsics), present
        # Half of the absent ones are replaced by another object of their size, the rest by nothing;
        # all of them by nothing where there is no other object.
        other = self.objects.draw(self.random, batch).numpy()
        while (same := absent & (other == index.numpy())).any() and len(self.objects) > 1:
            other[same] = self.objects.draw(self.random, int(same.sum())).numpy()
        shown = torch.from_numpy(np.where(absent, other, index.numpy()))
        size = self.objects.diameters(shown) / self.objects.diameters(index)
        placed = Pose(truth.rotation, truth.translation * size[:, None])
        seen = self.objects.render(shown, placed, intrinsics)
        empty = same | (absent & (self.random.random(batch) < 0.5))
        kept = torch.from_numpy(~empty).float().to(self.device)[:, None, None, None]
        depth = seen.depth / size.float()[:, None, None, None] * kept
        return GBuffer(seen.albedo * kept, seen.normal * kept, depth, seen.mask * kept), present

    def _directions(self, number: int) -> Tensor:
        """x / z and y / z of so many objects' centres: (B, 2)."""
        if self.config.crop == "look_at":
            return torch.zeros(number, 2, dtype=torch.float64)
        reach = self.config.max_off_axis
        return torch.from_numpy(self.random.uniform(-reach, reach, (number, 2)))

    def _zoom(self, number: int) -> Tensor:
        """How many times larger than usual each of so many crops shows its object: (B,)."""
        zoom = self.config.zoom
        if not zoom.probability:
            return torch.ones(number, dtype=torch.float64)
        low, high = np.log(zoom.factor)
        larger = np.exp(self.random.uniform(low, high, number))
        chosen = self.random.random(number) < zoom.probability
        chosen[: self.config.views.count(number)] = False  # templates show whole objects
        return torch.from_numpy(np.where(chosen, larger, 1.0))

    def _within(self, delta: Tensor) -> Tensor:
        """Which deltas (B, 6) lie within `max_delta`: bool (B,)."""
        largest = torch.tensor(self.config.max_delta, dtype=delta.dtype, device=delta.device)
        return (delta.abs() <= largest).all(-1)

    def _accepted(
        self, delta: Tensor, start: Pose, truth: Pose, diameter: Tensor, near: Tensor
    ) -> Tensor:
        """The deltas (B, 6), clamped; zero where not finite or where they would lose the object."""
        largest = torch.tensor(self.config.max_delta, dtype=torch.float64, device=delta.device)
        delta = delta.clamp(-largest, largest)
        crop = self.config.crop
        updated = PoseAction.from_delta(delta).apply_centred(start, diameter, crop)
        left = pose_delta(updated, truth, diameter, crop)
        keep = (self._within(left) | (near < 0.5)) & (left[:, :3].abs() <= largest[:3]).all(-1)
        keep = keep & (updated.translation[:, 2] > 1.5 * diameter) & delta.isfinite().all(-1)
        return torch.where(keep[:, None], delta, 0.0)  # a product with 0 would keep a NaN

    def _rendering(self, rendered: GBuffer) -> Tensor:
        """The start's rendering (B, 3, 128, 128) with errors of its colours."""
        return wrong_colours(rendered, self.config.texture_colour, self.rng)


def _objects(given: list[Mesh] | ObjectSet) -> ObjectSet:
    return MeshObjects(given) if isinstance(given, list) else given


def _place(direction: Tensor, depth: Tensor) -> Tensor:
    """Points (B, 3) in a direction (B, 2), x / z and y / z, at a depth (B,)."""
    return torch.cat([direction, torch.ones_like(depth)[:, None]], 1) * depth[:, None]


def _relative(buffer: GBuffer, distance: Tensor, diameter: Tensor) -> Tensor:
    """Depth behind the object's centre in diameters, 0 outside the object."""
    depth = buffer.depth / diameter.float()[:, None, None, None]
    return (depth - distance.float()[:, None, None, None]) * buffer.mask
