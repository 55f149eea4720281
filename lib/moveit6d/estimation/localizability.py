"""How much a pixel of error matters: what the size of an object in an image tells of its pose.

Never sees an image or asks the policy.
"""

from __future__ import annotations

import math

from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose

LIMIT = 0.1  # of the diameter: ADD's usual limit, which defines what is reported


def localizability(centred: Pose, mesh: Mesh, camera: Camera, width_error: float) -> float:
    """Probability that a pose which looks right is within a tenth of the diameter of the truth.

    An object at distance Z, f d / Z pixels wide, that is taken to be one pixel wider is taken to be
    Z² / (f d) nearer; of the six axes this one decides. The pose is centred; `width_error` is the
    standard deviation of the width, image pixels (`LoopConfig`).
    """
    distance = float(centred.translation[2])
    nearer = width_error * distance**2 / (camera.fx * mesh.diameter)
    return math.erf(LIMIT * mesh.diameter / (nearer * math.sqrt(2)))
