"""Polygons become triangles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from moveit6d.geometry.mesh import Mesh
from tests.support.obj_files import write


def test_concave_polygons_are_not_fanned(tmp_path: Path) -> None:
    arrow = [(0, 0), (4, 2), (0, 4), (1, 2)]  # the last corner points inwards
    rows = [f"v {x / 20} {y / 20} 0" for x, y in arrow] + ["f 2 3 4 1"]
    mesh = Mesh.load(write(tmp_path, obj="\n".join(rows)))
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2
    assert area == pytest.approx(6 / 400, rel=1e-4)
