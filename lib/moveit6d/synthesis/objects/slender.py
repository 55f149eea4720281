"""Objects like pens, scissors and boards: a mesh squeezed along one or two of its axes.

Never changes colours. Most objects that people scan are about as deep as they are wide; slender
ones cover few pixels of a patch and look alike from many sides.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ...geometry.mesh import Mesh
from .reshape import reshaped

LEFT = (0.12, 0.5)  # of a squeezed axis' length
SIZES = (0.08, 0.3)  # metres, the bounding sphere's diameter
FLAT = 0.5  # share of those that are squeezed along one axis; the others are along two


def slender_copy(rng: np.random.Generator, mesh: Mesh) -> Mesh:
    """The mesh squeezed along its shortest principal axes, of another size, in its own colours.

    One that declares symmetries comes back as it is: squeezed it would not have them.
    """
    if not mesh.symmetries.is_trivial:
        return mesh
    points = mesh.vertices.astype(np.float64)
    points = points - points.mean(0)
    axes = np.linalg.eigh(points.T @ points)[1]  # columns, the shortest axis first
    low, high = np.log(LEFT)
    factors = np.exp(rng.uniform(low, high, 3))
    factors[2] = 1.0
    if rng.random() < FLAT:
        factors[1] = 1.0
    points = points @ axes * factors @ axes.T
    size = float(np.exp(rng.uniform(*np.log(SIZES))))
    reach = 2 * float(np.linalg.norm(points, axis=1).max())
    copy = reshaped(mesh, points * (size / reach))
    return replace(copy, name=f"slender_{mesh.name}")
