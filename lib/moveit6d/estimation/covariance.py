"""How uncertain a pose is: from the information of its last update to a covariance in metres.

Never sees an image and never changes a pose.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from ..geometry.crop import OBJECT_SIZE, Crop, view_of
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..networks.least_squares import LONGEST


@dataclass(frozen=True, eq=False)
class Information:
    """What an image said of an update, as `PolicyOutput` has it, and in which crop.

    `matrix` (6, 6) is of the pose delta; `diameter` (metres) is that of the sphere that filled the
    crop; `error` the standard deviation of a cell's displacement, patch pixels.
    """

    matrix: Tensor
    diameter: Tensor
    crop: Crop
    error: float


def pose_covariance(known: Information, centred: Pose, mesh: Mesh) -> Tensor:
    """Covariance (6, 6), float64, of a pose (unbatched) whose last update had this information.

    Of the translation of the pose in the mesh file's frame, metres, and of its rotation vector,
    radians; along and about the camera's axes. `centred` is that pose.
    """
    # No update is longer, so that nothing is less certain.
    least = torch.eye(6, dtype=torch.float64) / LONGEST**2
    units = torch.linalg.inv(known.matrix.to(torch.float64) / known.error**2 + least)
    slopes = update_jacobian(centred, mesh, known.diameter, known.crop)
    covariance: Tensor = slopes @ units @ slopes.mT
    return (covariance + covariance.mT) / 2


def update_jacobian(centred: Pose, mesh: Mesh, diameter: Tensor, crop: Crop) -> Tensor:
    """How the pose in the mesh file's frame changes with a pose delta, at zero: (6, 6).

    Rows are the translation, metres, and the rotation vector, radians, in the camera's axes;
    columns those of the delta, in units of a crop that a sphere of this diameter fills.
    """
    view = view_of(centred, diameter.to(torch.float64), crop)
    virtual = view.rotation @ centred.translation
    slopes = torch.zeros(6, 6, dtype=torch.float64)
    slopes[0, 0] = slopes[1, 1] = virtual[2] / view.intrinsics[0, 0]  # a pixel, metres
    slopes[:3, 2] = -virtual / OBJECT_SIZE  # along the ray through the centre
    slopes[:3, :3] = view.rotation.mT @ slopes[:3, :3]
    slopes[3:, 3:] = turned = view.rotation.mT * (math.pi / 180)
    # The turn is about the object's centre, around which it moves the file's origin.
    arm = mesh.outer(centred).translation - centred.translation
    slopes[:3, 3:] = torch.linalg.cross(turned.mT, arm.expand(3, 3)).mT
    return slopes
