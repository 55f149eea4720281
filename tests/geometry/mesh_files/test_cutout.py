"""Masks cut holes."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from moveit6d.geometry.mesh import Mesh
from tests.support.obj_files import MTL, write


def test_a_mask_cuts_holes(tmp_path: Path) -> None:
    from PIL import Image

    mask = np.full((64, 96), 255, np.uint8)
    mask[:32, :32] = 0  # the side x = +0.05
    path = write(tmp_path, MTL + "map_d mask.png\n")
    Image.fromarray(mask).save(tmp_path / "mask.png")
    mesh = Mesh.load(path)
    centres = (mesh.vertices + mesh.center)[mesh.faces].mean(1)
    assert not (centres[:, 0] > 0.0499).any()
    assert (centres[:, 0] < -0.0499).any()
