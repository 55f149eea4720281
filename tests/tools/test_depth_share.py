"""What a policy that knows a pose of wrong depth gets wrong is its depth alone."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from moveit6d import OraclePolicy
from moveit6d.config import LoopConfig
from moveit6d.geometry.crop import OBJECT_SIZE
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from tests.support import pictures
from tools.depth_share import errors_of


def test_depth_alone_is_corrected(brick: Mesh, tmp_path: Path) -> None:
    place = torch.tensor([0.0, 0.0, 0.5], dtype=torch.float64)
    true, wrong = (Pose(torch.eye(3).double(), factor * place) for factor in (1.0, 1.1))
    sequence = pictures.one_frame(tmp_path, brick, true, true)
    policy = OraclePolicy(Pose.stack([wrong]))
    (found,) = errors_of(sequence, 1, policy, make_renderer(), LoopConfig(mode="all_axes"))
    assert found.units == pytest.approx(0.1 * OBJECT_SIZE, abs=0.5)
    assert found.add == pytest.approx(0.05 / brick.diameter, abs=0.02)
    assert found.with_depth < 0.01
