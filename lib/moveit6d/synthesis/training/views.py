"""Views for descriptors: an observed object and templates, renderings of it from other sides.

Never trains. A detector compares an image with templates; its descriptors must tell views of one
object apart, and objects from clutter.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from ...actions import PoseAction
from ...geometry.crop import View, crop_patches, look_at
from ...geometry.pose import Pose
from ...geometry.rotation import exp_so3, random_rotations
from ...rendering.renderer import GBuffer
from ...typing import Range
from ..augmentation.random_source import RandomSource
from ..objects.object_set import ObjectSet
from .equivalents import rotation_distance

if TYPE_CHECKING:
    from .pairs import TrainingBatch


@dataclass(frozen=True)
class ViewConfig:
    """Templates of a part of each batch, and how they differ from the truth.

    Args:
        share: of a batch's pairs that get templates.
        other_views: templates from other sides, of each pair.
        other_rotation: degrees of half of them from the truth; the others are rotated at random.
        positive_angle: degrees from the truth within which such a template is a positive, too.
        positive_rotation: degrees from the truth of the first template, the positive, at most.
        shift: of the image's centre, pixels of the crop at most.
        size: error of the object's width, pixels of the crop at most.
        distance: of the templates, in diameters.
    """

    share: float = 0.0
    other_views: int = 3
    other_rotation: Range = (30.0, 90.0)
    positive_angle: float = 25.0
    positive_rotation: float = 20.0
    shift: float = 4.5
    size: float = 10.0
    distance: Range = (3.5, 8.0)

    def count(self, batch: int) -> int:
        """How many of the first pairs of a batch get templates."""
        return min(batch, max(2, round(self.share * batch))) if self.share else 0


@dataclass(frozen=True)
class ViewBatch:
    """N crops with the object in the middle, and 1 + K templates of each.

    `image` (N, 3, 128, 128); `templates` (N, 1 + K, 3, 128, 128) and their `masks`
    (N, 1 + K, 1, 128, 128), the first one near the true view; `positive` (N, 1 + K) is 1 where a
    template is near an equivalent of the true view; `visible` (N,) is the object's visible share.
    """

    image: Tensor
    templates: Tensor
    masks: Tensor
    positive: Tensor
    visible: Tensor

    def to(self, device: torch.device) -> ViewBatch:
        """The same views on another device."""
        return ViewBatch(*(getattr(self, item.name).to(device) for item in fields(self)))

    def __getitem__(self, chosen: slice) -> ViewBatch:
        """A part of the views."""
        return ViewBatch(*(getattr(self, item.name)[chosen] for item in fields(self)))


def draw_views(
    pairs: TrainingBatch, old: View, truth: Pose, diameter: Tensor, objects: ObjectSet,
    config: ViewConfig, rng: RandomSource, rendering: Callable[[GBuffer], Tensor],
) -> ViewBatch:  # fmt: skip
    """Views of the first pairs of a batch, whose crops show the `old` view of the start.

    An absent object has visible share 0.
    """
    count = config.count(len(pairs.mesh))
    old, truth, diameter, index = (
        old[:count],
        truth[:count],
        diameter[:count],
        pairs.mesh[:count],
    )
    off = rng.uniform(count, 3, between=(-1.0, 1.0)).double()
    off = off * torch.tensor([config.shift, config.shift, config.size]).to(off)
    centre = PoseAction.from_delta(torch.cat([off, torch.zeros_like(off)], 1)).apply_centred(
        truth, diameter
    )
    view = look_at(centre, diameter)
    # From the start's crop to the one around the truth: both cameras are in one place.
    between = View(view.rotation @ old.rotation.mT, view.intrinsics, view.distance)
    layers = torch.cat([pairs.observation.image, pairs.visible, pairs.true_mask], 1)[:count]
    layers = crop_patches(layers, between, old.intrinsics)
    whole = layers[:, 4].flatten(1).sum(1)
    usable = pairs.present[:count] * (whole > 40)
    visible = usable * layers[:, 3].flatten(1).sum(1) / whole.clamp_min(1)
    offsets = _template_rotations(count, config, rng)  # (N, 1 + K, 3, 3)
    seen = (view.rotation @ truth.rotation)[:, None]
    rotation = (offsets @ seen).flatten(0, 1)
    each = index.repeat_interleave(config.other_views + 1)
    symmetries = [objects.symmetries(number) for number in each.tolist()]
    angle = rotation_distance(symmetries, rotation, seen.expand_as(offsets).flatten(0, 1))
    positive = (angle < config.positive_angle).float().reshape(count, -1)
    positive[:, 0] = 1
    distance = rng.uniform(len(each), between=config.distance).double()
    size = objects.diameters(each)
    ahead = torch.nn.functional.pad((distance * size)[:, None], (2, 0))
    poses = Pose(rotation, ahead)
    drawn = objects.render(each, poses, look_at(poses, size).intrinsics)
    shape = (count, config.other_views + 1)
    templates, masks = (
        part.reshape(*shape, *part.shape[1:]) for part in (rendering(drawn), drawn.mask)
    )
    return ViewBatch(layers[:, :3], templates, masks, positive, visible)


def _template_rotations(count: int, config: ViewConfig, rng: RandomSource) -> Tensor:
    """Rotations (N, 1 + K, 3, 3) from the truth to the templates."""
    number = config.other_views + 1
    axis = torch.nn.functional.normalize(rng.normal(count, number, 3).double(), dim=-1)
    angle = rng.uniform(count, number, 1, between=config.other_rotation).double()
    angle[:, 0] = rng.uniform(count, 1).double() * config.positive_rotation
    bounded = exp_so3(axis * torch.deg2rad(angle))
    free = random_rotations(count * number, rng.generator).reshape(bounded.shape)
    is_free = torch.arange(number, device=bounded.device) > (number + 1) // 2
    return torch.where(is_free[None, :, None, None], free, bounded)
