"""What a policy that knows a pose of wrong depth gets wrong is its depth alone."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from PIL import Image

from moveit6d import OraclePolicy
from moveit6d.config import LoopConfig
from moveit6d.datasets.sequences import Sequence
from moveit6d.geometry.crop import OBJECT_SIZE
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from moveit6d.synthesis.objects.mesh_file import write_glb
from tests.support import pictures
from tools.depth_share import errors_of


def test_depth_alone_is_mended(brick: Mesh, tmp_path: Path) -> None:
    (tmp_path / "frames").mkdir()
    place = torch.tensor([0.0, 0.0, 0.5], dtype=torch.float64)
    true, wrong = (Pose(torch.eye(3).double(), factor * place) for factor in (1.0, 1.1))
    seen = pictures.picture(brick, true)
    Image.fromarray(seen.permute(1, 2, 0).numpy()).save(tmp_path / "frames" / "0.png")
    mesh, stated = tmp_path / "mesh.glb", brick.outer(true)
    write_glb(mesh, brick)
    sequence = Sequence(
        "one", tmp_path, mesh, tmp_path / "frames", pictures.CAMERA, stated, 0, {0: stated}
    )
    policy = OraclePolicy(Pose.stack([wrong]))
    (found,) = errors_of(sequence, 1, policy, make_renderer(), LoopConfig(mode="all_axes"))
    assert found.units == pytest.approx(0.1 * OBJECT_SIZE, abs=0.5)
    assert found.add == pytest.approx(0.05 / brick.diameter, abs=0.02)
    assert found.with_depth < 0.01
