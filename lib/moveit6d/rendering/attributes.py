"""From "this ray meets that face there" to normal and colour, the same for every back end.

Never decides what is visible; back ends do.
"""

from __future__ import annotations

import math
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from ..geometry.mesh import Mesh
from ..typing import Float32
from .texture import MipMap


class Attributes:
    """A mesh's normals and colours, laid out for interpolation on many faces at once.

    `table` (F, 3C + 3) holds C values (normal, then colour or texture coordinates) at a face's
    first corner, the differences of the other two corners from it, and the face's own normal. A
    face's numbers lie together: with hundreds of thousands of faces each is a miss of the cache.
    """

    def __init__(self, mesh: Mesh) -> None:
        colour = mesh.uv if mesh.uv is not None else mesh.vertex_colors
        assert colour is not None
        values = np.concatenate([mesh.corner_normals, colour[mesh.faces]], -1, dtype=np.float32)
        values[:, 1:] -= values[:, :1]  # (F, 3, C)
        a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
        table = np.concatenate([values.reshape(len(values), -1), np.cross(b - a, c - a)], axis=1)
        self._table = np.ascontiguousarray(table)
        self.texture = None if mesh.texture is None else MipMap(mesh)
        self._radius = 0.5 * mesh.sphere_diameter

    @staticmethod
    def of(mesh: Mesh) -> Attributes:
        """The mesh's attributes, computed when first asked for and kept as long as the mesh is."""
        attributes = _KEPT.get(mesh)
        if attributes is None:
            attributes = _KEPT[mesh] = Attributes(mesh)
        return attributes

    def at(
        self, face: NDArray[np.intp], u: Float32, v: Float32, rays: Float32, rotation: Float32
    ) -> tuple[Float32, Float32]:
        """Normals (3, N), camera frame, and values for `colour` (N, C − 3).

        The point on face (N,) is corner 0 + u·(corner 1 − corner 0) + v·(corner 2 − corner 0); it
        is seen along rays (3, N) of the camera's frame, to which rotation (3, 3) takes the object.
        """
        # (3C + 3, N): whole rows are handled at once, which is what makes numpy fast here.
        row = np.ascontiguousarray(self._table.take(face, axis=0).T)
        count = len(row) // 3 - 1
        values = row[:count] + u * row[count : 2 * count]
        values += v * row[2 * count : 3 * count]  # (C, N)
        behind = ((rotation @ row[-3:]) * rays).sum(0) > 0
        return _turned(rotation @ values[:3], rays, behind), values[3:].T

    def colour(
        self, values: Float32, intrinsics: NDArray[np.float64], depth: float
    ) -> NDArray[np.uint8]:
        """RGB (N, 3) of the values that `at` gave, for pixels of an object at this depth."""
        if self.texture is None:
            return (values + np.float32(0.5)).astype(np.uint8)
        focal = math.sqrt(abs(float(intrinsics[0, 0] * intrinsics[1, 1])))
        return self.texture.sample(values, focal / max(depth, self._radius))


_KEPT: WeakKeyDictionary[Mesh, Attributes] = WeakKeyDictionary()


def pixel_rays(pixel: NDArray[np.intp], intrinsics: NDArray[np.float64], size: int) -> Float32:
    """Rays (3, N) through the centres of a patch's pixels, given by flat indices; z is 1."""
    (fx, skew, cx), (_, fy, cy) = intrinsics[:2]
    rays = np.ones((3, len(pixel)), np.float32)
    row = pixel // size
    rays[1] = (row - cy) / fy
    rays[0] = (pixel - row * size - cx - skew * rays[1]) / fx
    return rays


def _turned(normals: Float32, rays: Float32, behind: NDArray[Any]) -> Float32:
    """Unit normals (3, N) on the camera's side of the surface.

    Those of faces seen from `behind` are negated. Near the outline a smooth normal may still look
    away a little; it is tilted back until it is perpendicular to its ray.
    """
    normals *= np.where(behind, np.float32(-1), np.float32(1))
    excess = (normals * rays).sum(0)
    away = np.flatnonzero(excess > 0)
    if len(away):
        ray = rays[:, away]
        normals[:, away] -= np.float32(1.001) * excess[away] / (ray * ray).sum(0) * ray
    normals /= np.maximum(np.sqrt((normals * normals).sum(0)), np.float32(1e-12))
    return normals
