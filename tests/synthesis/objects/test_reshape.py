"""Other vertices, the same triangles and colours."""

import numpy as np

from moveit6d.synthesis.objects.reshape import reshaped
from tests.support.pairs import objects


def test_a_mesh_keeps_its_colours_in_another_size() -> None:
    mesh = objects()[0]
    large = reshaped(mesh, 2 * mesh.vertices)
    np.testing.assert_allclose(large.diameter, 2 * mesh.diameter, rtol=1e-5)
    assert np.array_equal(large.faces, mesh.faces) and large.texture is mesh.texture
    assert large.name == mesh.name and large.symmetries.is_trivial
