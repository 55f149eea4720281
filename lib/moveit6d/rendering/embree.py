"""Ray casting on the CPU through embree: the default back end, without OpenGL or a display.

Never shades, and never keeps a mesh alive: what is built for a mesh goes when the mesh goes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray
from torch import Tensor

from ..errors import RenderingUnavailable
from ..geometry.crop import PATCH_SIZE
from ..geometry.hull import enclosing_corners
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..typing import Float32
from .attributes import Attributes, pixel_rays
from .renderer import GBuffer, check_batch, gather

Arrays = tuple[NDArray[np.uint8], Float32, Float32]


WHEELS = "Linux and Windows on x86-64 and for macOS 13 or newer"


class EmbreeRenderer:
    """Casts one ray through each pixel's centre; both sides of every triangle are visible."""

    name = "embree"

    def __init__(self) -> None:
        try:
            import embreex.rtcore_scene  # noqa: F401
        except ImportError as error:
            raise RenderingUnavailable(
                f"The embree renderer lacks its Python package: pip install embreex ({error}). It "
                f"has wheels for {WHEELS}; elsewhere, as on Linux on ARM (Jetson, Raspberry Pi), "
                "use --renderer pyrender or build embreex."
            ) from error

    def render(
        self, meshes: Sequence[Mesh], poses: Pose, intrinsics: Tensor, size: int = PATCH_SIZE
    ) -> GBuffer:
        """One patch for each mesh; see `Renderer`."""
        check_batch(meshes, poses, intrinsics, size)
        return gather(render_arrays, meshes, poses, intrinsics, size)


def render_arrays(
    mesh: Mesh,
    rotation: NDArray[Any],
    translation: NDArray[Any],
    intrinsics: NDArray[Any],
    size: int = PATCH_SIZE,
) -> Arrays:
    """One patch as plain arrays, for whoever renders in worker processes without tensors.

    Rotation (3, 3) and translation (3,) take the centred frame to the camera; intrinsics (3, 3).
    Returns albedo (H, W, 3) uint8, normal (H, W, 3) and depth (H, W) float32; where depth is 0
    there is no object.
    """
    albedo = np.zeros((size * size, 3), np.uint8)
    normal = np.zeros((size * size, 3), np.float32)
    depth = np.zeros(size * size, np.float32)
    turn, place = np.asarray(rotation, np.float64), np.asarray(translation, np.float64)
    camera = np.asarray(intrinsics, np.float64)
    tree, attributes = _Tree.of(mesh), Attributes.of(mesh)
    pixel = _pixels(tree.hull @ turn.T + place, camera, size)
    rays = pixel_rays(pixel, camera, size)
    hit, face, u, v, distance = tree.cast(rays, turn, place)
    pixel = pixel[hit]
    normals, values = attributes.at(face, u, v, rays[:, hit], turn.astype(np.float32))
    depth[pixel] = distance
    normal[pixel] = normals.T
    if len(pixel):
        albedo[pixel] = attributes.colour(values, camera, float(place[2]))
    shape = (size, size)
    return albedo.reshape(*shape, 3), normal.reshape(*shape, 3), depth.reshape(shape)


class _Tree:
    """Embree's search tree of a mesh, and the corners of a convex body around it."""

    def __init__(self, mesh: Mesh) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self._embree = EmbreeScene()
        self._triangles = TriangleMesh(self._embree, mesh.vertices, mesh.faces)
        self._reach = 0.505 * mesh.sphere_diameter
        self.hull = enclosing_corners(mesh.vertices.astype(np.float64))

    @staticmethod
    def of(mesh: Mesh) -> _Tree:
        tree = _TREES.get(mesh)
        if tree is None:
            tree = _TREES[mesh] = _Tree(mesh)
        return tree

    def cast(
        self, rays: Float32, turn: NDArray[np.float64], place: NDArray[np.float64]
    ) -> tuple[NDArray[np.intp], NDArray[np.intp], Float32, Float32, Float32]:
        """Follow rays (3, M), z = 1, from the camera to the object at that pose.

        Returns, for the N rays that meet it: which ray, which face, u and v on it, and the depth.
        """
        # In the object's frame, and from just before the object, where float32 is finest. Because
        # z is 1, the distance along a ray is depth, and one product gives the origins.
        start = max(0.0, float(place[2]) - self._reach)
        shift = start * turn
        shift[2] -= place @ turn
        origins, towards = rays.T @ shift.astype(np.float32), rays.T @ turn.astype(np.float32)
        found = self._embree.run(origins, towards, output=True)
        hit = np.flatnonzero(found["primID"] >= 0)
        face = found["primID"][hit].astype(np.intp)
        return hit, face, found["u"][hit], found["v"][hit], found["tfar"][hit] + np.float32(start)


_TREES: WeakKeyDictionary[Mesh, _Tree] = WeakKeyDictionary()


def _pixels(
    hull: NDArray[np.float64], intrinsics: NDArray[np.float64], size: int
) -> NDArray[np.intp]:
    """Flat indices of the pixels that may see the object with this hull (N, 3), camera frame.

    All pixels where the hull reaches behind the camera or far outside of the patch.
    """
    import cv2

    everywhere = np.arange(size * size)
    if hull[:, 2].min() < 1e-3 * np.abs(hull).max():
        return everywhere
    corners = (hull[:, :2] / hull[:, 2:]) @ intrinsics[:2, :2].T + intrinsics[:2, 2]
    if not np.abs(corners).max() < 8 * size + 1000:  # beyond OpenCV's fixed point, or NaN
        return everywhere
    outline = cv2.convexHull(corners.astype(np.float32))
    inside = np.zeros((size, size), np.uint8)
    cv2.fillConvexPoly(inside, np.rint(outline * 16).astype(np.int32), 1, shift=4)
    return np.flatnonzero(inside)
