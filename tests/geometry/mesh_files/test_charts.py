"""Colours of faces become patches of a texture."""

import numpy as np
import trimesh

from moveit6d.geometry.mesh import Mesh


def test_face_colours_stay_apart(tmp_path):
    vertices = [[0, 0, 0], [0.1, 0, 0], [0.1, 0.1, 0], [0, 0.1, 0]]
    faces, colors = [[0, 1, 2], [0, 2, 3]], [[255, 0, 0, 255], [0, 0, 255, 255]]
    sheet = trimesh.Trimesh(vertices, faces, face_colors=colors, process=False)
    sheet.export(tmp_path / "sheet.ply")
    mesh = Mesh.load(tmp_path / "sheet.ply")
    per_face = mesh.vertex_colors[mesh.faces]  # (2, 3, 3)
    np.testing.assert_array_equal(per_face[0], [[255, 0, 0]] * 3)
    np.testing.assert_array_equal(per_face[1], [[0, 0, 255]] * 3)
