"""Views for descriptors: an object as the camera sees it, and renderings of it from other sides.

Never trains. A detector compares a picture with renderings from all sides (templates); what it
compares must tell views of one object apart, and objects from what lies about.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import TYPE_CHECKING

import torch
from torch import Tensor

from ...actions import PoseAction
from ...geometry.crop import crop_patches, look_at
from ...geometry.pose import Pose
from ...geometry.rotation import exp_so3, random_rotations
from ...rendering.renderer import GBuffer
from ..augmentation.augment import RandomSource
from ..objects.object_set import ObjectSet
from .equivalents import turned_from

if TYPE_CHECKING:
    from .pairs import TrainingBatch

Range = tuple[float, float]


@dataclass(frozen=True)
class ViewConfig:
    """How many of a batch's pairs get templates, and how those differ from the truth."""

    share: float = 0.0
    others: int = 3  # templates from other sides …
    turned: Range = (30.0, 90.0)  # … half of them turned by so many degrees, the others anyhow
    equivalent: float = 25.0  # degrees within which a template from another side is a right one
    near: float = 20.0  # degrees by which the right template is turned at most
    shift: float = 4.5  # pixels of the patch by which the picture is off at most
    size: float = 10.0  # pixels of the object's width by which it is off at most
    distance: Range = (3.5, 8.0)  # of the templates, diameters

    def count(self, batch: int) -> int:
        """How many of the first pairs of a batch get templates."""
        return min(batch, max(2, round(self.share * batch))) if self.share else 0


@dataclass(frozen=True)
class ViewBatch:
    """N pictures in the middle of which the object stands, and 1 + K templates of each.

    `image` (N, 3, 128, 128); `templates` (N, 1 + K, 3, 128, 128) and their `masks`
    (N, 1 + K, 1, 128, 128), the first from the right side; `right` (N, 1 + K) is 1 where a template
    is (nearly) equivalent to the right one; `visible` (N,) is the share of the object that shows.
    """

    image: Tensor
    templates: Tensor
    masks: Tensor
    right: Tensor
    visible: Tensor

    def to(self, device: torch.device) -> ViewBatch:
        """The same views on another device."""
        return ViewBatch(*(getattr(self, item.name).to(device) for item in fields(self)))


def draw_views(
    pairs: TrainingBatch, start: Pose, truth: Pose, diameter: Tensor, objects: ObjectSet,
    config: ViewConfig, rng: RandomSource, rendering: Callable[[GBuffer], Tensor],
) -> ViewBatch:  # fmt: skip
    """Views of the first pairs of a batch; where something else is shown none is visible."""
    count = config.count(len(pairs.mesh))
    start, truth, diameter, index = (
        start[:count],
        truth[:count],
        diameter[:count],
        pairs.mesh[:count],
    )
    off = rng.uniform(count, 3, between=(-1.0, 1.0)).double()
    off = off * torch.tensor([config.shift, config.shift, config.size]).to(off)
    centre = PoseAction.from_delta(torch.cat([off, torch.zeros_like(off)], 1)).apply_centred(
        truth, diameter
    )
    view, old = look_at(centre, diameter), look_at(start, diameter)
    # From the start's patch to the one around the truth: both cameras stand in one place.
    between = type(view)(view.rotation @ old.rotation.mT, view.intrinsics, view.distance)
    layers = torch.cat([pairs.observation.image, pairs.visible, pairs.true_mask], 1)[:count]
    layers = crop_patches(layers, between, old.intrinsics)
    whole = layers[:, 4].flatten(1).sum(1)
    usable = pairs.present[:count] * (whole > 40)
    visible = usable * layers[:, 3].flatten(1).sum(1) / whole.clamp_min(1)
    turns = _turns(count, config, rng)  # (N, 1 + K, 3, 3)
    seen = (view.rotation @ truth.rotation)[:, None]
    rotation = (turns @ seen).flatten(0, 1)
    each = index.repeat_interleave(config.others + 1)
    symmetries = [objects.symmetries(number) for number in each.tolist()]
    angle = turned_from(symmetries, rotation, seen.expand_as(turns).flatten(0, 1))
    right = (angle < config.equivalent).float().reshape(count, -1)
    right[:, 0] = 1
    distance = rng.uniform(len(each), between=config.distance).double()
    size = objects.diameters(each)
    ahead = torch.nn.functional.pad((distance * size)[:, None], (2, 0))
    poses = Pose(rotation, ahead)
    drawn = objects.render(each, poses, look_at(poses, size).intrinsics)
    shape = (count, config.others + 1)
    templates, masks = (
        part.reshape(*shape, *part.shape[1:]) for part in (rendering(drawn), drawn.mask)
    )
    return ViewBatch(layers[:, :3], templates, masks, right, visible)


def _turns(count: int, config: ViewConfig, rng: RandomSource) -> Tensor:
    """Turns (N, 1 + K, 3, 3) from the truth to the templates."""
    number = config.others + 1
    axis = torch.nn.functional.normalize(rng.normal(count, number, 3).double(), dim=-1)
    angle = rng.uniform(count, number, 1, between=config.turned).double()
    angle[:, 0] = rng.uniform(count, 1).double() * config.near
    turns = exp_so3(axis * torch.deg2rad(angle))
    anyhow = random_rotations(count * number, rng.generator).reshape(turns.shape)
    free = torch.arange(number, device=turns.device) > (number + 1) // 2
    return torch.where(free[None, :, None, None], anyhow, turns)
