"""A GLB file holds the object: its place, and its colours if it has any of its own."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from moveit6d.geometry.mesh import Mesh
from moveit6d.synthesis.objects.mesh_file import write_glb
from tests.support.meshes import colored_box, sphere


def test_colours_come_back(tmp_path: Path) -> None:
    mesh = colored_box(offset=(0.02, 0.01, -0.03))
    write_glb(tmp_path / "box.glb", mesh)
    back = Mesh.load(tmp_path / "box.glb")
    np.testing.assert_allclose(back.center, mesh.center, atol=1e-7)
    assert mesh.vertex_colors is not None and back.vertex_colors is not None
    np.testing.assert_array_equal(
        np.unique(back.vertex_colors, axis=0), np.unique(mesh.vertex_colors, axis=0)
    )


def test_a_plain_mesh_comes_back_plain(tmp_path: Path) -> None:
    mesh = sphere(subdivisions=2)
    write_glb(tmp_path / "ball.glb", mesh)
    back = Mesh.load(tmp_path / "ball.glb")  # refuses a file that names a flat colour
    assert not back.has_colours and back.vertex_colors is not None
    np.testing.assert_array_equal(back.vertex_colors[0], mesh.vertex_colors[0])  # type: ignore
