"""Rigid poses, batched: where an object stands in front of a camera.

Never knows pixels, meshes or networks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from ..checks import shown
from ..errors import InputError
from .rotation import nearest_rotation

# A published rotation may be off by this much (largest entry of R Rᵀ − I) and is then projected.
ORTHONORMAL_TOLERANCE = 0.05


@dataclass(frozen=True)
class Pose:
    """Object → camera, OpenCV axes (x right, y down, z forward), metres: X_cam = R X_obj + t.

    `rotation` (..., 3, 3) and `translation` (..., 3) share their leading (batch) shape. Values are
    taken as they are, so that gradients flow; for numbers from outside use `Pose.checked`.
    """

    rotation: Tensor
    translation: Tensor

    def __post_init__(self) -> None:
        shape = self.translation.shape[:-1]
        if self.rotation.shape != (*shape, 3, 3) or self.translation.shape[-1:] != (3,):
            raise InputError(
                f"Pose: rotation {tuple(self.rotation.shape)} and translation "
                f"{tuple(self.translation.shape)} must be (..., 3, 3) and (..., 3)."
            )

    @staticmethod
    def identity(*batch: int, dtype: torch.dtype = torch.float64) -> Pose:
        """The pose that changes nothing, of the given batch shape."""
        rotation = torch.eye(3, dtype=dtype).expand(*batch, 3, 3)
        return Pose(rotation, torch.zeros(*batch, 3, dtype=dtype))

    @staticmethod
    def from_matrix(matrix: Tensor) -> Pose:
        """From homogeneous matrices (..., 4, 4)."""
        return Pose(matrix[..., :3, :3], matrix[..., :3, 3])

    @staticmethod
    def stack(poses: Sequence[Pose]) -> Pose:
        """Poses of one shape as one batch, with a new first axis."""
        return Pose(
            torch.stack([pose.rotation for pose in poses]),
            torch.stack([pose.translation for pose in poses]),
        )

    @staticmethod
    def checked(rotation: Any, translation: Any, where: str = "pose") -> Pose:
        """A float64 pose from any numbers, or an `InputError` that names `where` they came from.

        `rotation` is (..., 3, 3) or flat (..., 9) row-major. Rotations that are slightly off (as
        published ones sometimes are) are projected onto SO(3); singular, left-handed, scaled or
        non-finite ones are refused.
        """
        r, t = _numbers(rotation, where, "rotation"), _numbers(translation, where, "translation")
        if r.shape[-2:] != (3, 3) and r.shape[-1:] == (9,):
            r = r.reshape(*r.shape[:-1], 3, 3)
        if r.shape[-2:] != (3, 3) or t.shape != (*r.shape[:-2], 3):
            raise InputError(
                f"{where}: the rotation must be 3×3 and the translation 3 numbers, "
                f"found shapes {tuple(r.shape)} and {tuple(t.shape)}."
            )
        for name, values in (("rotation", r), ("translation", t)):
            if not torch.isfinite(values).all():
                raise InputError(f"{where}: the {name} holds a number that is not finite.")
        determinant = torch.linalg.det(r)
        if (determinant < -0.5).any():
            raise InputError(
                f"{where}: the rotation is left-handed (determinant "
                f"{determinant.min().item():.3f}); check for a flipped axis."
            )
        off = (r @ r.mT - torch.eye(3, dtype=r.dtype)).abs().amax()
        if off > ORTHONORMAL_TOLERANCE or (determinant < 0.5).any():
            raise InputError(
                f"{where}: the 3×3 matrix is not a rotation (R·Rᵀ differs from the identity by "
                f"{off.item():.3g}, determinant {determinant.min().item():.3g})."
            )
        return Pose(nearest_rotation(r), t)

    @property
    def batch_shape(self) -> torch.Size:
        """The leading shape that rotation and translation share."""
        return self.translation.shape[:-1]

    def __len__(self) -> int:
        return self.translation.shape[0]

    def __getitem__(self, index: Any) -> Pose:
        """Part of the batch, indexed as a tensor's leading axes are."""
        return Pose(self.rotation[index], self.translation[index])

    def matrix(self) -> Tensor:
        """Homogeneous matrices (..., 4, 4)."""
        top = torch.cat([self.rotation, self.translation[..., None]], -1)
        bottom = top.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(*self.batch_shape, 1, 4)
        return torch.cat([top, bottom], -2)

    def inverse(self) -> Pose:
        """Camera → object."""
        back = self.rotation.mT
        return Pose(back, -(back @ self.translation[..., None])[..., 0])

    def __matmul__(self, other: Pose) -> Pose:
        """This pose after the other: (a @ b).transform(x) = a.transform(b.transform(x))."""
        moved = (self.rotation @ other.translation[..., None])[..., 0] + self.translation
        return Pose(self.rotation @ other.rotation, moved)

    def transform(self, points: Tensor) -> Tensor:
        """Points of the object in the camera's frame: (..., N, 3) → (..., N, 3)."""
        return points @ self.rotation.mT + self.translation[..., None, :]

    def to(self, target: torch.dtype | torch.device) -> Pose:
        """The same pose in another dtype or on another device."""
        return Pose(self.rotation.to(target), self.translation.to(target))

    def detach(self) -> Pose:
        """The same numbers without their gradient."""
        return Pose(self.rotation.detach(), self.translation.detach())


def _numbers(values: Any, where: str, name: str) -> Tensor:
    if isinstance(values, Tensor):
        return values.detach().to("cpu", torch.float64)
    try:
        return torch.from_numpy(np.array(values, dtype=np.float64))
    except (TypeError, ValueError, OverflowError, RecursionError):
        raise InputError(f"{where}: the {name} must be numbers, found {shown(values)}.") from None
