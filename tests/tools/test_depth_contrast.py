"""The outline fits best at the true distance, and beside it where the true pose is wrong."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch
from PIL import Image

from moveit6d.datasets.sequences import Sequence
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from moveit6d.synthesis.objects.mesh_file import write_glb
from tests.support import pictures
from tools.depth_contrast import best_factors

PLACE = torch.tensor([0.02, -0.01, 0.5], dtype=torch.float64)


@pytest.mark.parametrize("wrong", [1.0, 1.02, 0.98])
def test_the_factor_is_that_of_the_pictures(brick: Mesh, tmp_path: Path, wrong: float) -> None:
    (tmp_path / "frames").mkdir()
    seen = pictures.picture(brick, Pose(torch.eye(3).double(), PLACE))
    Image.fromarray(seen.permute(1, 2, 0).numpy()).save(tmp_path / "frames" / "0.png")
    stated = brick.outer(Pose(torch.eye(3).double(), wrong * PLACE))
    mesh = tmp_path / "mesh.glb"
    write_glb(mesh, brick)
    sequence = Sequence(
        "one", tmp_path, mesh, tmp_path / "frames", pictures.CAMERA, stated, 0, {0: stated}
    )
    found = best_factors(sequence, 1, make_renderer())
    assert found == pytest.approx([1 / wrong], abs=0.006)
