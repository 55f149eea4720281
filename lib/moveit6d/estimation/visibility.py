"""Whether a camera can see an object at all.

Never looks at an image.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose

NEAREST = 0.55  # distance in sphere diameters under which the camera would be inside the object
SMALLEST = 2.0  # pixels: half the width of an object that is too small to be refined


def check_start(pose: Pose, mesh: Mesh, camera: Camera) -> None:
    """`InputError` for a start pose (mesh file's frame) whose object the camera cannot see."""
    if pose.batch_shape != ():
        raise InputError(f"Start pose must be a single one, found batch {tuple(pose.batch_shape)}.")
    problem = start_problem(mesh.inner(pose.to(torch.float64)), mesh, camera)
    if problem is not None:
        raise InputError(problem)


def start_problem(centred: Pose, mesh: Mesh, camera: Camera) -> str | None:
    """The sentence that says why no loop can start at a centred pose; None if one can."""
    if not (torch.isfinite(centred.rotation).all() and torch.isfinite(centred.translation).all()):
        return "Start pose holds a number that is not finite."
    problem = out_of_sight(centred.translation, mesh.sphere_diameter, camera)
    return None if problem is None else f"Start pose: {problem}."


def out_of_sight(centre: Tensor, diameter: float, camera: Camera) -> str | None:
    """Why the camera cannot see a sphere with this centre (3,) and diameter, metres, if so."""
    x, y, depth = centre.tolist()
    if depth <= 0:
        return f"the object is behind the camera (z = {depth:.3g} m; z points forward)"
    if depth < NEAREST * diameter:
        return (
            f"the camera is inside the object (z = {depth:.3g} m, object {diameter:.3g} m across); "
            "check the unit of the mesh and of the pose"
        )
    u, v = _pixel(x, y, depth, camera)
    reach = 0.5 * diameter * camera.fx / depth
    if math.isinf(u):
        return "the object is outside of what the lens shows"
    if not (-reach < u < camera.width + reach and -reach < v < camera.height + reach):
        size = f"{camera.width}×{camera.height}"
        return f"the object is outside of the image (centre at pixel {u:.0f}, {v:.0f} of {size})"
    if reach < SMALLEST:
        return (
            f"the object is {2 * reach:.2g} pixels wide; check the unit of the mesh (now "
            f"{diameter:.3g} m across) and of the pose (z = {depth:.3g} m)"
        )
    return None


def _pixel(x: float, y: float, depth: float, camera: Camera) -> tuple[float, float]:
    """Where the camera sees a point; infinitely far away what its lens does not show.

    A twin of `Camera.project` on plain numbers: this runs for every pose of every loop.
    """
    lens = camera.lens
    if lens is None:
        u = camera.fx * x / depth + camera.skew * y / depth + camera.cx
        return u, camera.fy * y / depth + camera.cy
    point = np.array([[x, y, depth]])
    if not lens.shows(point)[0]:
        return math.inf, math.inf
    u, v = lens.project(point, camera.matrix.numpy())[0]
    return float(u), float(v)
