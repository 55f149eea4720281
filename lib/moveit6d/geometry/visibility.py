"""Whether a camera can see an object at a pose, judged by the object's own shape.

Never renders; what hides the object is not known here.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from .camera import Camera
from .hull import enclosing_corners
from .mesh import Mesh
from .pose import Pose

SMALLEST = 4.0  # pixels across below which nothing can be told of a pose
CORNERS = 128  # of the body that stands for the mesh: within about 3 % of its hull
EDGE = 1 - 1e-6  # of what a lens shows: just inside
NEAR = 1e-3  # of the object's size: what is nearer than this to the camera's plane has no pixel

Points = NDArray[np.float64]

# Unit vectors (2, 64) all around.
DIRECTIONS = np.stack([f(np.arange(64) * np.pi / 32) for f in (np.cos, np.sin)])


def why_unseen(pose: Pose, mesh: Mesh, camera: Camera) -> str | None:
    """Why the camera cannot see the mesh at a centred pose (unbatched), None if it can.

    What counts is the convex hull: in front of the camera, reaching into what its lens shows of the
    image, and not around the camera itself.
    """
    body = _Body.of(mesh)
    rotation, place = pose.rotation.detach().cpu().numpy(), pose.translation.detach().cpu().numpy()
    corners = body.corners @ rotation.T + place  # (N, 3)
    depth, size = float(place[2]), mesh.sphere_diameter
    if depth <= 0 or corners[:, 2].max() <= 0:
        return f"the object is behind the camera (z = {depth:.3g} m; z points forward)"
    if depth < size and body.holds(-rotation.T @ place):
        return (
            f"the camera is inside the object (z = {depth:.3g} m, object {size:.3g} m across); "
            "check the unit of the mesh and of the pose"
        )
    pixels = _pixels(_in_front(corners, NEAR * size), camera)
    if not len(pixels):
        return "the object is outside of what the lens shows"
    low, high = pixels.min(0), pixels.max(0)
    shape = np.array([camera.width, camera.height])
    if (high < -0.5).any() or (low > shape - 0.5).any():
        return f"the object is outside of the image ({_centre(place, camera)})"
    if (high - low).max() < SMALLEST:
        return (
            f"the object is {(high - low).max():.2g} pixels wide; check the unit of the mesh (now "
            f"{size:.3g} m across) and of the pose (z = {depth:.3g} m)"
        )
    return None


def seen_box(pose: Pose, mesh: Mesh, camera: Camera) -> tuple[float, float, float, float]:
    """Left, top, right and bottom of a mesh at a centred pose (unbatched) that the camera can see.

    Of its convex hull, pixels, within about 3 %, and not cut off at the image's edges.
    """
    rotation, place = pose.rotation.detach().cpu().numpy(), pose.translation.detach().cpu().numpy()
    corners = _Body.of(mesh).corners @ rotation.T + place
    pixels = _pixels(_in_front(corners, NEAR * mesh.sphere_diameter), camera)
    (left, top), (right, bottom) = pixels.min(0), pixels.max(0)
    return float(left), float(top), float(right), float(bottom)


class _Body:
    """The corners of a convex body around a mesh, and its sides."""

    def __init__(self, mesh: Mesh) -> None:
        from scipy.spatial import ConvexHull, QhullError

        self.corners: Points = enclosing_corners(mesh.vertices.astype(np.float64), CORNERS)
        try:
            self._sides = ConvexHull(self.corners).equations
        except (QhullError, ValueError):  # flat: nothing can be inside
            self._sides = None

    @staticmethod
    def of(mesh: Mesh) -> _Body:
        body = _BODIES.get(mesh)
        if body is None:
            body = _BODIES[mesh] = _Body(mesh)
        return body

    def holds(self, point: Points) -> bool:
        if self._sides is None:
            return False
        return bool((self._sides[:, :3] @ point + self._sides[:, 3] < 0).all())


_BODIES: WeakKeyDictionary[Mesh, _Body] = WeakKeyDictionary()


def _in_front(corners: Points, near: float) -> Points:
    """The corners beyond the near plane, and where the body's lines cross that plane."""
    front = corners[:, 2] > near
    if front.all():
        return corners
    ahead, behind = corners[front], corners[~front]
    if not len(ahead):
        return np.array([[0.0, 0.0, near]])
    a, b = ahead[:: 1 + len(ahead) // 50], behind[:: 1 + len(behind) // 50]
    share = (near - b[None, :, 2]) / (a[:, None, 2] - b[None, :, 2])
    crossing = b[None] + share[..., None] * (a[:, None] - b[None])
    return np.concatenate([ahead, crossing.reshape(-1, 3)])


def _pixels(points: Points, camera: Camera) -> Points:
    """Pixels (N, 2) of points (N, 3) in front of the camera, as its lens shows them.

    What is beyond what the lens shows comes to the edge of that; none where all of their convex
    hull is beyond.
    """
    plane = points[:, :2] / points[:, 2:]  # z = 1
    lens = camera.lens
    if lens is None:
        u = camera.fx * plane[:, 0] + camera.skew * plane[:, 1] + camera.cx
        return np.stack([u, camera.fy * plane[:, 1] + camera.cy], -1)
    if ((plane @ DIRECTIONS).min(0) > lens.reach).any():
        return np.zeros((0, 2))
    aside = np.hypot(*plane.T)[:, None]
    plane = plane * np.minimum(1.0, EDGE * lens.reach / np.maximum(aside, NEAR))
    return lens.project(np.column_stack([plane, np.ones(len(plane))]), camera.matrix.numpy())


def _centre(place: Points, camera: Camera) -> str:
    pixels = _pixels(place[None], camera)
    size = f"{camera.width}×{camera.height}"
    if not len(pixels):
        return f"its centre is beyond what the lens shows of {size}"
    return f"centre at pixel {pixels[0, 0]:.0f}, {pixels[0, 1]:.0f} of {size}"
