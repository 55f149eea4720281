"""How uncertain a pose is: from the information of its last update to a covariance in metres.

Never sees an image and never changes a pose. Covariances (6, 6), float64, are of a translation,
metres, and of a rotation vector, radians, along and about the camera's axes.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ..geometry.crop import OBJECT_SIZE, Crop, view_of
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose

LARGEST = 40.0  # action units: no update is longer, so that nothing is less certain


def centred_covariance(
    information: Tensor, centred: Pose, diameter: Tensor, crop: Crop, error: float
) -> Tensor:
    """Covariance (6, 6) of a centred pose, unbatched, by the information (6, 6) of its last update.

    `diameter` (metres) is that of the sphere that filled the crop, and `error` the standard
    deviation of a cell's displacement, patch pixels.
    """
    least = torch.eye(6, dtype=torch.float64) / LARGEST**2
    units = torch.linalg.inv(information.to(torch.float64) / error**2 + least)
    slopes = update_jacobian(centred, diameter, crop)
    covariance: Tensor = slopes @ units @ slopes.mT
    return (covariance + covariance.mT) / 2


def outer_covariance(covariance: Tensor, centred: Pose, mesh: Mesh) -> Tensor:
    """The covariance (6, 6) of the pose in the mesh file's frame, given that of the centred one.

    A turn is about the object's centre, around which it moves the file's origin.
    """
    arm = mesh.outer(centred).translation - centred.translation
    moves = torch.eye(6, dtype=torch.float64)
    moves[:3, 3:] = torch.linalg.cross(torch.eye(3, dtype=torch.float64), arm.expand(3, 3)).mT
    moved: Tensor = moves @ covariance @ moves.mT
    return (moved + moved.mT) / 2


def update_jacobian(centred: Pose, diameter: Tensor, crop: Crop) -> Tensor:
    """How a centred pose changes with a pose delta, at zero: (6, 6).

    Rows are its translation, metres, and the rotation vector, radians, in the camera's axes;
    columns those of the delta, in units of a crop that a sphere of this diameter fills.
    """
    view = view_of(centred, diameter.to(torch.float64), crop)
    virtual = view.rotation @ centred.translation
    slopes = torch.zeros(6, 6, dtype=torch.float64)
    slopes[0, 0] = slopes[1, 1] = virtual[2] / view.intrinsics[0, 0]  # a pixel, metres
    slopes[:3, 2] = -virtual / OBJECT_SIZE  # along the ray through the centre
    slopes[:3, :3] = view.rotation.mT @ slopes[:3, :3]
    slopes[3:, 3:] = view.rotation.mT * (math.pi / 180)
    return slopes
