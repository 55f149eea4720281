"""Whether a loop can start at a pose: the sentences for poses that the camera cannot see.

Never looks at an image; what a camera sees of a mesh is `geometry.visibility`'s.
"""

from __future__ import annotations

import torch

from ..errors import InputError
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose, in_metres
from ..geometry.visibility import why_unseen


def check_start(pose: Pose, mesh: Mesh, camera: Camera) -> None:
    """`InputError` for a start pose (mesh file's frame) whose object the camera cannot see."""
    if pose.batch_shape != ():
        raise InputError(f"Start pose must be a single one, found batch {tuple(pose.batch_shape)}.")
    in_metres(pose, "Start pose", mesh.center)
    problem = start_problem(mesh.inner(pose.to(torch.float64)), mesh, camera)
    if problem is not None:
        raise InputError(problem)


def start_problem(centred: Pose, mesh: Mesh, camera: Camera) -> str | None:
    """The sentence that says why no loop can start at a centred pose; None if one can."""
    if not (torch.isfinite(centred.rotation).all() and torch.isfinite(centred.translation).all()):
        return "Start pose holds a number that is not finite."
    problem = why_unseen(centred, mesh, camera)
    return None if problem is None else f"Start pose: {problem}."
