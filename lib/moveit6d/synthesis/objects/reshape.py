"""A mesh with its vertices elsewhere, in its own colours.

Never keeps symmetries: another shape may not have them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ...geometry.mesh import Mesh


def reshaped(mesh: Mesh, vertices: NDArray[np.floating]) -> Mesh:
    """The mesh with other vertices (V, 3), metres."""
    return Mesh.from_arrays(
        mesh.name,
        vertices,
        mesh.faces,
        uv=mesh.uv,
        texture=mesh.texture,
        vertex_colors=mesh.vertex_colors,
    )
