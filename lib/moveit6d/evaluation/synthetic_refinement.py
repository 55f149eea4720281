"""Refines synthetic cases, whose starts and true poses are known, and measures the errors.

Never makes the pictures; `synthesis.single_images` does.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..config import ContourConfig, MultiStartConfig, TrackerConfig
from ..estimation import TrackingResult, refine_single
from ..geometry.mesh import Mesh
from ..policies import Policy
from ..rendering.renderer import Renderer
from ..synthesis.single_images import Case
from .metrics import add

LOOP_ONLY = TrackerConfig(
    multi_start=MultiStartConfig(enabled=False), contour=ContourConfig(enabled=False)
)


@dataclass(frozen=True)
class RefinedCase:
    """ADD before and after in diameters of the object (inf without a pose), and the result."""

    before: float
    after: float
    result: TrackingResult


def run_cases(
    cases: Sequence[Case],
    policy: Policy,
    renderer: Renderer,
    config: TrackerConfig = LOOP_ONLY,
    batch: int = 16,
) -> Iterator[RefinedCase]:
    """Refine the cases in batches, as `PoseEstimator` does, and measure them."""
    points: dict[Mesh, Tensor] = {}
    for begin in range(0, len(cases), batch):
        part = cases[begin : begin + batch]
        targets = [case.target for case in part]
        results = refine_single(
            targets,
            policy=policy,
            renderer=renderer,
            config=config,
        )
        for case, result in zip(part, results, strict=True):
            mesh = case.target.mesh
            if mesh not in points:
                points[mesh] = torch.from_numpy(mesh.sample_points(1000))
            before = float(add(case.target.pose, case.truth, points[mesh])) / mesh.diameter
            after = np.inf
            if result.pose is not None:
                after = float(add(result.pose, case.truth, points[mesh])) / mesh.diameter
            yield RefinedCase(before, after, result)
