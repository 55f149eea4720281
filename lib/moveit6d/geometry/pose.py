"""Rigid poses, batched: where an object stands in front of a camera.

Never knows pixels, meshes or networks.
"""

from __future__ import annotations

import json
import logging
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import torch
from torch import Tensor

from ..errors import InputError
from ..io import read_text, write_json
from ..typing import Numbers
from .numbers import float64_of, floating, vectors
from .rotation import exp_so3, from_quaternion, log_so3, nearest_rotation, to_quaternion

LOG = logging.getLogger("moveit6d")
# A published rotation may be off by this much (largest entry of R Rᵀ − I) and is then projected.
ORTHONORMAL_TOLERANCE = 0.05
# Metres: no object that fills a crop stands farther away; such a translation is in millimetres.
FARTHEST = 100.0
HOLDS = 'a pose file holds {"rotation": 3x3, "translation": [x, y, z]}, metres, or a 4x4 matrix'


@dataclass(frozen=True, eq=False, repr=False)
class Pose:
    """Object → camera, OpenCV axes (x right, y down, z forward), metres: X_cam = R X_obj + t.

    `rotation` (..., 3, 3) and `translation` (..., 3) share their leading (batch) shape. Values are
    taken as they are, so that gradients flow, and whole numbers become float64; for numbers from
    outside use `Pose.checked`. Two
    poses are equal only if they are the same object: whether numbers are near is the caller's to
    say.
    """

    rotation: Tensor
    translation: Tensor

    def __post_init__(self) -> None:
        for name in ("rotation", "translation"):
            object.__setattr__(self, name, floating(getattr(self, name), "Pose", name))
        if self.rotation.dtype != self.translation.dtype:
            kind = torch.promote_types(self.rotation.dtype, self.translation.dtype)
            object.__setattr__(self, "rotation", self.rotation.to(kind))
            object.__setattr__(self, "translation", self.translation.to(kind))
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
    def from_matrix(matrix: Any) -> Pose:
        """From homogeneous matrices (..., 4, 4).

        A tensor is taken as it is, so that gradients flow; an array or nested lists are checked as
        `checked` does, and become float64. `InputError` for another shape.
        """
        if isinstance(matrix, Tensor):
            _check_shape(matrix, "Pose.from_matrix")
            return Pose(matrix[..., :3, :3], matrix[..., :3, 3])
        return _of_matrix(matrix, "Pose.from_matrix")

    @staticmethod
    def from_quaternion(quaternion: Any, translation: Any, order: Literal["xyzw", "wxyz"]) -> Pose:
        """From quaternions (..., 4) and translations (..., 3) in metres, float64.

        `order` says where the real part is: xyzw in ROS and SciPy, wxyz in many data sets.
        `InputError` unless the quaternions are of about unit length.

        >>> Pose.from_quaternion([0, 0, 0, 1], [0, 0, 0.5], order="xyzw")
        Pose(translation=[0.0000, 0.0000, 0.5000] m, rotation=[0.00, 0.00, 0.00] deg)
        """
        _check_order(order, "Pose.from_quaternion")
        q = float64_of(quaternion, "Pose.from_quaternion", "quaternion")
        if q.shape[-1:] == (1,) and q.shape[-2:-1] == (4,):
            q = q[..., 0]
        if q.shape[-1:] != (4,) or not torch.isfinite(q).all():
            raise InputError(
                "Pose.from_quaternion: a quaternion has 4 finite numbers, found shape "
                f"{tuple(q.shape)}."
            )
        off = _largest(q.norm(dim=-1) - 1)
        if off > ORTHONORMAL_TOLERANCE:
            raise InputError(
                f"Pose.from_quaternion: a quaternion must have length 1, this one is off by "
                f"{off:.3g}."
            )
        wxyz = q.roll(1, -1) if order == "xyzw" else q
        rotation = from_quaternion(torch.nn.functional.normalize(wxyz, dim=-1))
        return Pose.checked(rotation, translation, "Pose.from_quaternion")

    @staticmethod
    def from_rvec(rvec: Any, tvec: Any) -> Pose:
        """From a rotation vector and a translation as `cv2.solvePnP` gives them, float64.

        (..., 3), or (3, 1) and (1, 3); radians and metres.
        """
        both = []
        for name, values in (("rvec", rvec), ("tvec", tvec)):
            numbers = float64_of(values, "Pose.from_rvec", name)
            numbers = numbers.reshape(3) if numbers.shape in ((3, 1), (1, 3)) else numbers
            if numbers.shape[-1:] != (3,) or not torch.isfinite(numbers).all():
                raise InputError(
                    f"Pose.from_rvec: {name} must be 3 finite numbers, found shape "
                    f"{tuple(numbers.shape)}."
                )
            both.append(numbers)
        return Pose.checked(exp_so3(both[0]), both[1], "Pose.from_rvec")

    @staticmethod
    def load(path: str | Path) -> Pose:
        """The pose of a pose.json: `rotation` 3×3 and `translation` in metres; float64.

        Or of a homogeneous matrix, checked as `from_matrix` does: a JSON list of its four rows, or
        text of four lines of four numbers (as `numpy.savetxt` writes it). `InputError` names the
        file and what is wrong with it. How far away the object stands is judged where its mesh is
        known: the origin of a mesh file may be anywhere.
        """
        content = _content(Path(path))
        if isinstance(content, list):
            pose = _of_matrix(content, str(path))
        else:
            pose = _of_entries(content, path)
        if pose.batch_shape:
            raise InputError(f"{path}: one pose expected, found {pose.batch_shape[0]}.")
        return pose

    def save(self, path: str | Path) -> None:
        """Write a pose.json that `load` reads back exactly."""
        if self.batch_shape:
            raise InputError(f"{path}: a pose.json holds one pose, not {tuple(self.batch_shape)}.")
        content = {"rotation": self.rotation.tolist(), "translation": self.translation.tolist()}
        write_json(Path(path), content)

    @staticmethod
    def stack(poses: Sequence[Pose]) -> Pose:
        """Poses of one shape as one batch, with a new first axis; `InputError` for none."""
        if not poses:
            raise InputError("Pose.stack: there is no pose to stack.")
        return Pose(
            torch.stack([pose.rotation for pose in poses]),
            torch.stack([pose.translation for pose in poses]),
        )

    @staticmethod
    def checked(rotation: Any, translation: Any, where: str = "pose") -> Pose:
        """A float64 pose from any numbers, or an `InputError` that names `where` they came from.

        `rotation` is (..., 3, 3) or flat (..., 9) row-major, `translation` (..., 3) or the column
        (..., 3, 1) that OpenCV gives. Rotations that are slightly off (as
        published ones sometimes are) are projected onto SO(3); singular, left-handed, scaled or
        non-finite ones are refused.
        """
        r, t = (
            float64_of(rotation, where, "rotation"),
            float64_of(translation, where, "translation"),
        )
        if r.shape[-2:] != (3, 3) and r.shape[-1:] == (9,):
            r = r.reshape(*r.shape[:-1], 3, 3)
        if t.shape == (*r.shape[:-2], 3, 1):
            t = t[..., 0]
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
        off = _largest(r @ r.mT - torch.eye(3, dtype=r.dtype))
        if off > ORTHONORMAL_TOLERANCE or (determinant < 0.5).any():
            raise InputError(
                f"{where}: the 3×3 matrix is not a rotation (R·Rᵀ differs from the identity by "
                f"{off:.3g}, determinant {determinant.min().item():.3g})."
            )
        return Pose(nearest_rotation(r), t)

    def __repr__(self) -> str:
        """Translation in metres and rotation vector in degrees, or the batch shape."""
        if self.batch_shape:
            return f"Pose(batch of {tuple(self.batch_shape)}, {self.translation.dtype})"
        turn = torch.rad2deg(log_so3(self.rotation.detach())).tolist()
        place = self.translation.detach().tolist()
        return (
            f"Pose(translation=[{', '.join(f'{v:.4f}' for v in place)}] m, "
            f"rotation=[{', '.join(f'{v:.2f}' for v in turn)}] deg)"
        )

    @property
    def batch_shape(self) -> torch.Size:
        """The leading shape that rotation and translation share."""
        return self.translation.shape[:-1]

    def __len__(self) -> int:
        return self.translation.shape[0]

    def __getitem__(self, index: Any) -> Pose:
        """Part of the batch, indexed as a tensor's leading axes are."""
        return Pose(self.rotation[index], self.translation[index])

    @property
    def matrix(self) -> Tensor:
        """Homogeneous matrices (..., 4, 4)."""
        top = torch.cat([self.rotation, self.translation[..., None]], -1)
        bottom = top.new_tensor([0.0, 0.0, 0.0, 1.0]).expand(*self.batch_shape, 1, 4)
        return torch.cat([top, bottom], -2)

    def quaternion(self, order: Literal["xyzw", "wxyz"]) -> Tensor:
        """Unit quaternions (..., 4), the real part not negative; see `from_quaternion`."""
        _check_order(order, "Pose.quaternion")
        wxyz = to_quaternion(self.rotation)
        return wxyz.roll(-1, -1) if order == "xyzw" else wxyz

    def inverse(self) -> Pose:
        """Camera → object."""
        back = self.rotation.mT
        return Pose(back, -(back @ self.translation[..., None])[..., 0])

    def __matmul__(self, other: Pose) -> Pose:
        """This pose after the other: (a @ b).transform(x) = a.transform(b.transform(x))."""
        if not isinstance(other, Pose):
            raise InputError(
                f"Pose @: the other must be a Pose, found a {type(other).__name__}; "
                "Pose.from_matrix(matrix) makes one, Pose.transform(points) moves points."
            )
        if self.rotation.dtype != other.rotation.dtype:
            kind = torch.promote_types(self.rotation.dtype, other.rotation.dtype)
            return self.to(kind) @ other.to(kind)
        moved = (self.rotation @ other.translation[..., None])[..., 0] + self.translation
        return Pose(self.rotation @ other.rotation, moved)

    def transform(self, points: Numbers) -> Tensor:
        """Points of the object in the camera's frame: (..., N, 3) → (..., N, 3), (3,) → (..., 3).

        Lists and arrays will do, and become tensors of the pose's type; `InputError` for others.

        >>> Pose(torch.eye(3), torch.tensor([0.0, 0.0, 0.5])).transform([[0.1, 0.0, 0.0]])
        tensor([[0.1000, 0.0000, 0.5000]])
        """
        points = vectors(points, 3, "Pose.transform", "points").to(self.rotation.dtype)
        if points.dim() == 1:
            return self.transform(points[None])[..., 0, :]
        return points @ self.rotation.mT + self.translation[..., None, :]

    def to(self, target: torch.dtype | torch.device) -> Pose:
        """The same pose in another dtype or on another device."""
        return Pose(self.rotation.to(target), self.translation.to(target))

    def detach(self) -> Pose:
        """The same numbers without their gradient."""
        return Pose(self.rotation.detach(), self.translation.detach())


def _check_order(order: str, where: str) -> None:
    if order not in ("xyzw", "wxyz"):
        raise InputError(f"{where}: the order is {order!r}, must be 'xyzw' or 'wxyz'.")


def _largest(values: Tensor) -> float:
    """The largest absolute value, 0 of none; NaN if one is."""
    return float(values.abs().amax()) if values.numel() else 0.0


def _check_shape(matrix: Tensor, where: str) -> None:
    if matrix.shape[-2:] != (4, 4):
        raise InputError(f"{where}: found shape {tuple(matrix.shape)}, not 4×4.")


def _of_matrix(matrix: Any, where: str) -> Pose:
    numbers = float64_of(matrix, where, "matrix")
    _check_shape(numbers, where)
    if _largest(numbers[..., 3, :] - numbers.new_tensor([0.0, 0.0, 0.0, 1.0])) > 1e-6:
        raise InputError(f"{where}: the last row must be 0, 0, 0, 1; is the matrix transposed?")
    return Pose.checked(numbers[..., :3, :3], numbers[..., :3, 3], where)


def _of_entries(content: dict[str, Any], path: str | Path) -> Pose:
    missing = [key for key in ("rotation", "translation") if key not in content]
    if missing:
        raise InputError(
            f"{path}: {' and '.join(missing)} missing; a pose needs rotation (3×3) and "
            "translation (3 numbers, metres)."
        )
    unit = content.get("unit", content.get("units", "m"))
    if unit not in ("m", "metre", "metres", "meter", "meters"):
        raise InputError(
            f"{path}: its unit is {unit!r}, but a pose's translation is in metres; convert it "
            "and leave the unit out."
        )
    unknown = sorted(content.keys() - {"rotation", "translation", "unit", "units"})
    if unknown:
        LOG.warning(
            "%s: %s not used; a pose is rotation and translation, metres, object to camera.",
            path, ", ".join(unknown),
        )  # fmt: skip
    return Pose.checked(content["rotation"], content["translation"], where=str(path))


def _content(path: Path) -> dict[str, Any] | list[Any]:
    """What a pose file holds: a JSON object, or the four rows of a matrix."""
    try:
        text = read_text(path)
    except InputError as error:
        if isinstance(error.__cause__, UnicodeError):
            raise InputError(f"{path} is not a text file; {HOLDS}.") from None
        raise
    rows = [line.replace(",", " ").split() for line in text.splitlines() if line.strip()]
    with suppress(ValueError):
        if [len(row) for row in rows] == [4] * 4:
            return [[float(word) for word in row] for row in rows]
    with suppress(ValueError, RecursionError):
        content = json.loads(text)
        if isinstance(content, dict) or (isinstance(content, list) and len(content) == 4):
            return content
    raise InputError(f"{path} holds no pose; {HOLDS}.")


def in_metres(pose: Pose, where: str, center: Any = (0.0, 0.0, 0.0)) -> Pose:
    """The pose itself; `InputError` for a translation that must be in millimetres.

    `center` is the object's middle in the mesh file's frame (`Mesh.center`), which may lie far
    from that frame's origin; the object stands where the pose takes it.
    """
    shift = pose.translation.detach()
    middle = torch.as_tensor(center).to(shift)
    distance = float((pose.rotation.detach() @ middle + shift).norm())
    # A small translation is not in millimetres, whatever else may be wrong with it.
    if min(distance, float(shift.norm())) > FARTHEST:
        raise InputError(
            f"{where}: the object stands {distance:.0f} m away; the translation looks like "
            "millimetres, divide it by 1000."
        )
    return pose
