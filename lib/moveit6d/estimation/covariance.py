"""How uncertain a pose is: from the information of its last update to a covariance in metres.

Never sees an image and never changes a pose.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..geometry.crop import OBJECT_SIZE, Crop, view_of
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose

LARGEST = 40.0  # action units: no update is longer, so that nothing is less certain


def pose_covariance(
    information: Tensor, centred: Pose, mesh: Mesh, diameter: Tensor, crop: Crop, error: float
) -> Tensor:
    """Covariance (6, 6), float64, of a pose whose last update has this information (6, 6).

    Of the translation of the pose in the mesh file's frame, metres, and of its rotation vector,
    radians; along and about the camera's axes. `centred` is that pose, unbatched, `diameter`
    (metres) that of the sphere that filled the crop, and `error` the standard deviation of a cell's
    displacement, patch pixels.
    """
    least = torch.eye(6, dtype=torch.float64) / LARGEST**2
    units = torch.linalg.inv(information.to(torch.float64) / error**2 + least)
    slopes = update_jacobian(centred, mesh, diameter, crop)
    covariance: Tensor = slopes @ units @ slopes.mT
    return (covariance + covariance.mT) / 2


def update_jacobian(centred: Pose, mesh: Mesh, diameter: Tensor, crop: Crop) -> Tensor:
    """How the pose in the mesh file's frame changes with a pose delta, at zero: (6, 6).

    Rows are the translation, metres, and the rotation vector, radians, in the camera's axes;
    columns those of the delta, in units of a crop that a sphere of this diameter fills.
    """
    view = view_of(centred, diameter.to(torch.float64), crop)
    virtual = view.rotation @ centred.translation
    pixel = virtual[2] / view.intrinsics[0, 0]
    slopes = torch.zeros(6, 6, dtype=torch.float64)
    slopes[0, 0] = slopes[1, 1] = pixel
    slopes[:3, 2] = -virtual / OBJECT_SIZE  # along the ray through the centre
    turned = view.rotation.mT * (math.pi / 180)
    slopes[:3, :3] = view.rotation.mT @ slopes[:3, :3]
    slopes[3:, 3:] = turned
    # The turn is about the object's centre, which the file's origin moves around.
    arm = mesh.outer(centred).translation - centred.translation
    slopes[:3, 3:] = -torch.linalg.cross(arm.expand(3, 3), turned.mT).mT
    return slopes
