"""Normals: smooth across seams, not across creases."""

import numpy as np

from moveit6d.geometry.mesh import Mesh
from tests.support import meshes


def test_normals_cross_a_seam_but_not_a_crease():
    # Two coplanar triangles that share no vertex, and a third at a right angle.
    vertices = 0.1 * np.array(
        [
            [0, 0, 0],
            [1, 0, 0],
            [0, 1, 0],
            [1, 0, 0],
            [1, 1, 0],
            [0, 1, 0],
            [0, 0, 0],
            [0, 1, 0],
            [0, 0, 1],
        ]
    )
    mesh = Mesh.from_arrays("seam", vertices, [[0, 1, 2], [3, 4, 5], [6, 7, 8]])
    np.testing.assert_allclose(mesh.corner_normals[0], [[0, 0, 1]] * 3, atol=1e-6)
    np.testing.assert_allclose(mesh.corner_normals[2], [[1, 0, 0]] * 3, atol=1e-6)
    np.testing.assert_allclose(mesh.normals[0], mesh.normals[6], atol=1e-6)  # merged by position
    np.testing.assert_allclose(mesh.normals[4], [0, 0, 1], atol=1e-6)


def test_normals_of_a_sphere_point_outwards():
    mesh = meshes.sphere(subdivisions=4)
    radial = mesh.vertices / np.linalg.norm(mesh.vertices, axis=1, keepdims=True)
    cosine = (radial * mesh.normals).sum(1)
    assert np.degrees(np.arccos(cosine.min().clip(-1, 1))) < 0.5
    corner = (radial[mesh.faces] * mesh.corner_normals).sum(-1)
    assert np.degrees(np.arccos(corner.min().clip(-1, 1))) < 0.5


def test_both_sides_of_a_sheet_keep_their_normals():
    vertices = 0.1 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]])
    mesh = Mesh.from_arrays("sheet", vertices, [[0, 1, 2], [0, 2, 1]])
    np.testing.assert_allclose(mesh.corner_normals[:, 0], [[0, 0, 1], [0, 0, -1]], atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-6)
