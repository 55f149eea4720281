"""Objects of one material: a textured mesh whose texture has faded.

Never changes a shape. Networks learn to rely on texture where nearly every training object has
some; tools, parts and toys often have none.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from ...geometry.mesh import Mesh
from .textures import random_palette

KEPT = 0.25  # of the texture's contrast, at most
SAMPLES = 2000  # points at which a surface's colour is read


def untextured_copy(rng: np.random.Generator, mesh: Mesh) -> Mesh:
    """The mesh in one colour, its own mean or any other, with a remainder of its texture."""
    colours = mesh.texture if mesh.texture is not None else mesh.vertex_colors
    assert colours is not None
    mean = _mean_colour(rng, mesh)
    kept = rng.uniform(0.0, KEPT)
    ground = mean if rng.random() < 0.5 else np.array(random_palette(rng)[0], np.float32)
    faded = (ground + kept * (colours - mean)).round().clip(0, 255).astype(np.uint8)
    if mesh.texture is not None:
        return replace(mesh, texture=faded)
    return replace(mesh, vertex_colors=faded)


def _mean_colour(rng: np.random.Generator, mesh: Mesh) -> NDArray[np.float32]:
    """The surface's mean colour (3,): what a texture holds that no face uses does not count."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
    chosen = rng.choice(len(area), SAMPLES, p=area / area.sum())
    corners = mesh.faces[chosen, 0]
    if mesh.texture is None:
        assert mesh.vertex_colors is not None
        return np.asarray(mesh.vertex_colors[corners].mean(0), np.float32)
    assert mesh.uv is not None
    uv = mesh.uv[mesh.faces[chosen]].mean(1) % 1.0
    height, width = mesh.texture.shape[:2]
    column = (uv[:, 0] * width).astype(int).clip(0, width - 1)
    row = ((1 - uv[:, 1]) * height).astype(int).clip(0, height - 1)
    return np.asarray(mesh.texture[row, column].mean(0), np.float32)
