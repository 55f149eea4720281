"""The outline fits best at the true distance, and beside it where the true pose is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from tests.support import pictures
from tools.depth_contrast import best_factors

PLACE = torch.tensor([0.02, -0.01, 0.5], dtype=torch.float64)


@pytest.mark.parametrize("wrong", [1.0, 1.02, 0.98])
def test_the_factor_is_that_of_the_pictures(brick: Mesh, tmp_path: Path, wrong: float) -> None:
    seen, stated = (Pose(torch.eye(3).double(), factor * PLACE) for factor in (1.0, wrong))
    sequence = pictures.one_frame(tmp_path, brick, seen, stated)
    found = best_factors(sequence, 1, make_renderer())
    assert found == pytest.approx([1 / wrong], abs=0.006)
