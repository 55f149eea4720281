"""How likely a pose is right, by everything that can be seen there.

Never moves a pose.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields

import torch
from torch import Tensor
from torch.nn import functional

from ...contour import refine_contour
from ...geometry.crop import View, crop_patch, view_of
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...observation import Observation, observe
from ...policies import ActionMode, DescriptorPolicy, LoopState
from ...rendering.renderer import Renderer
from ..frame import Frame
from .config import JudgeConfig
from .templates import CELL, GREY


@dataclass(frozen=True)
class Evidence:
    """What speaks for a pose.

    `confidence` is the policy's at this very pose; `similarity` the mean cosine of image's and
    rendering's descriptors over the object; `contour` the share of the outline where the colours
    change sharply and in the right place; `movement` the largest of the six units by which the
    policy would still move; `correlation` of the grey values within the object, image against
    rendering.
    """

    confidence: float
    similarity: float
    contour: float
    movement: float
    correlation: float

    def probability(self, config: JudgeConfig) -> float:
        """That the pose is right."""
        total = config.intercept + sum(
            getattr(config, part.name) * getattr(self, part.name) for part in fields(self)
        )
        return 1 / (1 + math.exp(-max(-50.0, min(50.0, total))))


@torch.inference_mode()
def examine(
    frame: Frame, mesh: Mesh, poses: Sequence[Pose], policy: DescriptorPolicy, renderer: Renderer
) -> list[Evidence]:
    """What speaks for poses (mesh file's frame, all in sight) of one object in one image."""
    if not poses:
        return []
    centred = Pose.stack([mesh.inner(pose.to(torch.float64)) for pose in poses])
    diameter = torch.full((len(poses),), mesh.sphere_diameter, dtype=torch.float64)
    seen = _observe(frame, mesh, centred, diameter, policy, renderer)
    prediction = policy.predict(seen, LoopState(centred, diameter, torch.arange(len(poses))))
    movement = torch.zeros(len(poses))
    if policy.mode is ActionMode.ALL_AXES and prediction.delta is not None:
        movement = prediction.delta.abs().amax(-1).clamp(max=30.0)
    similarity, correlation = _similarity(seen, policy), _correlation(seen)
    matrix = frame.camera.matrix()
    return [
        Evidence(
            float(prediction.confidence[k]),
            float(similarity[k]),
            refine_contour(frame.pixels, matrix, mesh, centred[k], renderer).agreement,
            float(movement[k]),
            float(correlation[k]),
        )
        for k in range(len(poses))
    ]


def _observe(
    frame: Frame, mesh: Mesh, poses: Pose, diameter: Tensor, policy: DescriptorPolicy,
    renderer: Renderer,
) -> Observation:  # fmt: skip
    view, matrix = view_of(poses, diameter, policy.crop), frame.camera.matrix()
    patches = [
        crop_patch(
            frame.pixels, View(view.rotation[k], view.intrinsics[k], view.distance[k]), matrix
        )
        for k in range(len(poses))
    ]
    seen = renderer.render([mesh] * len(poses), view.to_virtual(poses), view.intrinsics)
    return observe(torch.stack(patches), seen, view, diameter)


def _similarity(seen: Observation, policy: DescriptorPolicy) -> Tensor:
    """Mean cosine (B,) of the descriptors over the object."""
    rendering = seen.rendering * seen.mask + GREY * (1 - seen.mask)
    described = policy.descriptors(torch.cat([seen.image, rendering]))
    described = described - described.mean((2, 3), keepdim=True)
    image, rendered = functional.normalize(described, dim=1).chunk(2)
    covered = functional.avg_pool2d(seen.mask, CELL)
    weight = torch.where(covered > 0.5, covered, 0.0)
    cosine = (image * rendered).sum(1, keepdim=True) * weight
    return cosine.sum((1, 2, 3)) / (weight.sum((1, 2, 3)) + 1e-6)


def _correlation(seen: Observation) -> Tensor:
    """Normalised correlation (B,) of blurred grey values within the object."""
    grey = torch.cat([seen.image, seen.rendering]).mean(1, keepdim=True)
    image, rendering = functional.avg_pool2d(grey, 4).chunk(2)
    weight = (functional.avg_pool2d(seen.mask, 4) > 0.9).float()
    total = weight.sum((2, 3), keepdim=True) + 1e-6
    a = (image - (image * weight).sum((2, 3), keepdim=True) / total) * weight
    b = (rendering - (rendering * weight).sum((2, 3), keepdim=True) / total) * weight
    product = (a * b).sum((1, 2, 3))
    return product / ((a * a).sum((1, 2, 3)) * (b * b).sum((1, 2, 3)) + 1e-9).sqrt()
