"""Symmetries of an object: the motions of its own frame that leave its looks unchanged.

Never guesses them from a mesh; they are declared by the user or read from a data set.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..checks import entry, listed, mapping, numbers
from ..errors import InputError
from .numbers import float64_of

# BOP cuts a full turn into ceil(pi / 0.01) rotations.
BOP_STEP_DEGREES = 360.0 / 315
# Of a list that is completed: the largest finite group of a solid has 60 rotations.
MOST_MOTIONS = 64
SAME_TURN = 0.05  # radians: measured symmetries are as far off
UNIT_TOLERANCE = 1e-3  # by which a unit vector of few digits is off


@dataclass(frozen=True, eq=False)
class ContinuousSymmetry:
    """Any rotation about an axis: unit `axis` (3,) through the point `offset` (3,), metres.

    `InputError` for an axis of another length and for what is no finite vector.
    """

    axis: NDArray[np.float64]
    offset: NDArray[np.float64]

    def __post_init__(self) -> None:
        for name in ("axis", "offset"):
            vector = float64_of(getattr(self, name), "ContinuousSymmetry", name).numpy()
            if vector.shape != (3,) or not np.isfinite(vector).all():
                raise InputError(
                    f"ContinuousSymmetry: the {name} must be 3 finite numbers, found "
                    f"{vector.tolist()}."
                )
            object.__setattr__(self, name, vector)
        length = float(np.linalg.norm(self.axis))
        if abs(length - 1) > UNIT_TOLERANCE:
            raise InputError(
                f"ContinuousSymmetry: the axis must have length 1, found {length:.6g}; divide it "
                "by its length."
            )
        if abs(length - 1) > 1e-12:
            object.__setattr__(self, "axis", self.axis / length)

    def cross(self) -> NDArray[np.float64]:
        """The matrix (3, 3) that takes the cross product with the axis from the left."""
        x, y, z = self.axis
        return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])

    def turn(self, angle: float) -> NDArray[np.float64]:
        """The motion (4, 4) by this angle, radians."""
        cross = self.cross()
        matrix = np.eye(4)
        matrix[:3, :3] += math.sin(angle) * cross + (1 - math.cos(angle)) * cross @ cross
        matrix[:3, 3] = self.offset - matrix[:3, :3] @ self.offset
        return matrix


@dataclass(frozen=True, eq=False)
class Symmetries:
    """Discrete motions (S, 4, 4) and continuous axes, in the mesh file's frame, metres.

    The identity need not be among the discrete ones; `transforms` adds it.
    """

    discrete: NDArray[np.float64] = field(default_factory=lambda: np.empty((0, 4, 4)))
    continuous: tuple[ContinuousSymmetry, ...] = ()

    def __post_init__(self) -> None:
        discrete = float64_of(self.discrete, "Symmetries", "discrete symmetries").numpy()
        if discrete.ndim != 3 or discrete.shape[1:] != (4, 4) or not np.isfinite(discrete).all():
            raise InputError(
                f"Symmetries: the discrete ones must be finite (S, 4, 4), found {discrete.shape}."
            )
        for number, matrix in enumerate(discrete):
            _check_rigid(matrix, f"Symmetries: discrete symmetry {number}")
        object.__setattr__(self, "discrete", discrete)
        axes = tuple(self.continuous) if isinstance(self.continuous, list | tuple) else (None,)
        if not all(isinstance(axis, ContinuousSymmetry) for axis in axes):
            raise InputError(
                "Symmetries: the continuous ones must be a list of ContinuousSymmetry(axis, "
                "offset)."
            )
        object.__setattr__(self, "continuous", axes)

    @staticmethod
    def from_bop(info: Mapping[str, Any]) -> Symmetries:
        """From one object's entry of BOP's models_info.json (millimetres there, metres here)."""
        discrete = listed(info.get("symmetries_discrete") or (), "symmetries_discrete")
        continuous = listed(info.get("symmetries_continuous") or (), "symmetries_continuous")
        return Symmetries(
            np.array([_matrix_from_bop(flat) for flat in discrete]).reshape(-1, 4, 4),
            tuple(_axis_from_bop(one) for one in continuous),
        )

    def to_bop(self) -> dict[str, Any]:
        """What `from_bop` reads back, millimetres: the keys of those symmetries that there are."""
        found: dict[str, Any] = {}
        if len(self.discrete):
            matrices = self.discrete.copy()
            matrices[:, :3, 3] *= 1000
            found["symmetries_discrete"] = matrices.reshape(-1, 16).tolist()
        if self.continuous:
            found["symmetries_continuous"] = [
                {"axis": one.axis.tolist(), "offset": (1000 * one.offset).tolist()}
                for one in self.continuous
            ]
        return found

    @property
    def is_trivial(self) -> bool:
        """Whether the object has no symmetry but the identity."""
        return len(self.discrete) == 0 and not self.continuous

    def transforms(self, step_degrees: float = BOP_STEP_DEGREES) -> NDArray[np.float64]:
        """All motions as (S, 4, 4), the identity first; axes are cut into steps of this angle.

        As in BOP: every rotation of every axis is composed on the left of every discrete motion;
        several axes stand side by side and are not multiplied with each other.
        """
        if not 0 < step_degrees <= 360:
            raise InputError(f"Symmetries: step_degrees is {step_degrees}, must be in (0, 360].")
        count = math.ceil(360.0 / step_degrees - 1e-9)
        turns = [np.eye(4)]
        for symmetry in self.continuous:
            turns += [symmetry.turn(2 * math.pi * k / count) for k in range(1, count)]
        others = [m for m in self.discrete if not np.allclose(m, np.eye(4), atol=1e-9)]
        discrete = np.stack([np.eye(4), *others])  # (D, 4, 4)
        composed = np.stack(turns)[None] @ discrete[:, None]  # (D, C, 4, 4)
        return np.ascontiguousarray(composed.reshape(-1, 4, 4))

    def closed(self) -> Symmetries:
        """With all products of the discrete motions, of which a quarter turn alone names four.

        A complete list stays as it is, and so does one without an end (`MOST_MOTIONS`).
        """
        found = [np.eye(4), *self.discrete]
        if len(found) > MOST_MOTIONS:
            return self
        for one in found:  # grows on the way
            for motion in self.discrete:
                product = motion @ one
                left, _, right = np.linalg.svd(product[:3, :3])
                product[:3, :3] = left @ right  # or rounded numbers drift off a rotation
                # Two motions of an object that turn it alike are the same one.
                apart = np.linalg.norm((np.stack(found) - product)[:, :3, :3], axis=(1, 2))
                if apart.min() > math.sqrt(2) * SAME_TURN:
                    found.append(product)
            if len(found) > MOST_MOTIONS:
                return self
        if len(found) == 1 + len(self.discrete):
            return self
        return replace(self, discrete=np.stack(found[1:]))

    def centred(self, center: NDArray[np.float64]) -> NDArray[np.float64]:
        """`transforms` in the frame whose origin is at `center` (3,) of the file's: (S, 4, 4)."""
        motions = self.transforms()
        motions[:, :3, 3] += motions[:, :3, :3] @ center - center
        return motions


def _matrix_from_bop(flat: Any) -> NDArray[np.float64]:
    rows = listed(flat, "symmetries_discrete: a symmetry")
    if rows and isinstance(rows[0], list | tuple):  # four rows instead of one line
        rows = [value for row in rows for value in listed(row, "symmetries_discrete: a row")]
    values = numbers(rows, 16, "symmetries_discrete: a symmetry")
    matrix = np.array(values).reshape(4, 4)
    matrix[:3, 3] *= 1e-3
    return matrix


def _axis_from_bop(content: Any) -> ContinuousSymmetry:
    where = "symmetries_continuous: a symmetry"
    declared = mapping(content, where)
    axis = np.array(numbers(entry(declared, "axis", where), 3, f"{where}'s axis"))
    offset = np.array(numbers(declared.get("offset") or (0, 0, 0), 3, f"{where}'s offset"))
    length = float(np.linalg.norm(axis))
    if not 0 < length < math.inf:
        raise InputError(f"{where}'s axis has no direction: {axis.tolist()}.")
    return ContinuousSymmetry(axis / length, offset * 1e-3)


def _check_rigid(matrix: NDArray[np.float64], what: str) -> None:
    rotation = matrix[:3, :3]
    rigid = np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-3) and np.linalg.det(rotation) > 0
    if not rigid or not np.allclose(matrix[3], (0, 0, 0, 1)):
        raise InputError(f"{what} is not a rotation with a translation (4×4, last row 0 0 0 1).")
