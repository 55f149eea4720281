"""How likely a pose is right, by everything that can be seen there.

Never changes a pose.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch.nn import functional

from ...config import VerificationConfig
from ...frame import Frame
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...observation import GREY, observe
from ...policies import DescriptorPolicy
from ...rendering.renderer import Renderer
from ..states import from_log_odds, log_odds
from .templates import CELL, cell_weights


@dataclass(frozen=True)
class Evidence:
    """What speaks for a pose.

    `confidence` is the policy's at the end of the refinement, as it is for searches
    (`search_policy`); `similarity` the mean cosine of the
    image's and the rendering's descriptors over the object.
    """

    confidence: float
    similarity: float

    def probability(self, config: VerificationConfig, present: bool = False) -> float:
        """That the pose is right; `present`: the object is known to be in the image."""
        return from_log_odds(
            config.intercept
            + config.present * present
            + config.confidence * log_odds(self.confidence)
            + config.similarity * self.similarity
        )


@torch.inference_mode()
def similarities(
    frame: Frame, mesh: Mesh, poses: Sequence[Pose], policy: DescriptorPolicy, renderer: Renderer
) -> list[float]:
    """Mean cosines of descriptors, image against rendering, at poses of one object in one image.

    Poses are centred and in sight.
    """
    if not poses:
        return []
    count = len(poses)
    diameter = torch.full((count,), mesh.sphere_diameter, dtype=torch.float64)
    observation = observe(
        [frame] * count, [mesh] * count, Pose.stack(poses), diameter, renderer, policy.crop
    )
    rendering = observation.rendering * observation.mask + GREY * (1 - observation.mask)
    described = policy.descriptors(torch.cat([observation.image, rendering]))
    described = described - described.mean((2, 3), keepdim=True)
    image, rendered = functional.normalize(described, dim=1).chunk(2)
    weight = cell_weights(functional.avg_pool2d(observation.mask, CELL))
    cosine = (image * rendered).sum(1, keepdim=True) * weight
    means: list[float] = (cosine.sum((1, 2, 3)) / (weight.sum((1, 2, 3)) + 1e-6)).tolist()
    return means
