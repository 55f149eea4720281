"""Textures: averaged where they are fine, repeated, no bleeding."""

import numpy as np

from moveit6d.geometry.mesh import Mesh
from tests.support import meshes
from tests.support.drawing import checkerboard, draw


def test_fine_textures_are_averaged_not_aliased():
    texture = (np.indices((512, 512)).sum(0) % 2 * 255).astype(np.uint8)
    albedo, _, _, mask = draw(meshes.square(texture=np.repeat(texture[..., None], 3, -1)), size=64)
    np.testing.assert_allclose(albedo[mask > 0], 0.5, atol=0.02)


def test_texels_that_no_face_uses_do_not_bleed_in():
    texture = np.zeros((256, 256, 3), np.uint8)
    texture[100:140, 20:90] = (200, 100, 50)
    vertices, faces, _, _ = meshes.box_arrays()
    chart = np.array([[20, 140], [90, 140], [90, 100], [20, 100]]) / 256 * (1, -1) + (0, 1)
    mesh = Mesh.from_arrays("box", vertices, faces, uv=np.tile(chart, (6, 1)), texture=texture)
    for size in (16, 128):
        albedo, _, _, mask = draw(mesh, seed=3, size=size)
        np.testing.assert_allclose(
            albedo[mask > 0] * 255, [[200, 100, 50]] * int(mask.sum()), atol=3
        )


def test_textures_repeat_outside_of_the_unit_square():
    texture, colors = checkerboard(2, 32)
    vertices = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]]) * 0.05
    uv = np.array([[-1, 2], [1, 2], [1, 0], [-1, 0]])
    mesh = Mesh.from_arrays("tiles", vertices, [[0, 2, 1], [0, 3, 2]], uv=uv, texture=texture)
    albedo, _, _, mask = draw(mesh, size=512)  # more pixels than one lookup of OpenCV takes
    rows, columns = np.nonzero(mask)
    centre = ((np.arange(4) + 0.5) * (np.ptp(rows) + 1) / 4).astype(int)
    seen = albedo[rows.min() + centre][:, columns.min() + centre] * 255
    np.testing.assert_allclose(seen, np.tile(colors, (2, 2, 1)), atol=2)
