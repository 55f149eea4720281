"""Symmetries of bodies that were put together from parts, found by comparing their points.

Never looks at textures: whoever asks knows that there is none. Parts of one colour each may look
the same after a motion only if every one of them does.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...geometry.symmetry import ContinuousSymmetry, Symmetries
from ...typing import Float64
from . import primitives as make
from .primitives import Part

AROUND = (24, 32)  # corners that `primitives` gives what it turns on a lathe
FOLDS = tuple(range(12, 1, -1))  # equal parts of a full turn about z that are looked for
SAME = 1e-6  # of the body's reach


def plain_symmetries(parts: Sequence[Part]) -> Symmetries:
    """Of plain parts about the origin: turns about z, half and quarter turns about x and y."""
    if any(_keeps(parts, make.about(2, 2 * np.pi / corners)) for corners in AROUND):
        axis = ContinuousSymmetry(np.array([0.0, 0.0, 1.0]), np.zeros(3))
        flip = make.about(0, np.pi)
        return Symmetries(_rigid([flip] if _keeps(parts, flip) else []), (axis,))
    about_z = [make.about(2, 2 * np.pi / fold) for fold in FOLDS]
    others = [make.about(axis, angle) for axis in (0, 1) for angle in (np.pi / 2, np.pi)]
    return Symmetries(_rigid(_group([turn for turn in about_z + others if _keeps(parts, turn)])))


def _group(turns: Sequence[Float64]) -> list[Float64]:
    """All products of the turns, without the identity."""
    found = [np.eye(3)]
    for one in found:  # grows on the way
        for turn in turns:
            product = turn @ one
            if not any(np.allclose(product, other, atol=1e-6) for other in found):
                found.append(product)
    return found[1:]


def placed(symmetries: Symmetries, turn: Float64, offset: Float64) -> Symmetries:
    """The symmetries of a body after a rotation (3, 3) about the origin and a shift (3,)."""
    moved = [turn @ motion[:3, :3] @ turn.T for motion in symmetries.discrete]
    discrete = _rigid(moved)
    discrete[:, :3, 3] = offset - discrete[:, :3, :3] @ offset
    axes = (ContinuousSymmetry(turn @ one.axis, offset) for one in symmetries.continuous)
    return Symmetries(discrete, tuple(axes))


def _rigid(rotations: Sequence[Float64]) -> Float64:
    matrices = np.tile(np.eye(4), (len(rotations), 1, 1))
    if len(rotations):
        matrices[:, :3, :3] = np.stack(rotations)
    return matrices


def _keeps(parts: Sequence[Part], rotation: Float64) -> bool:
    """Whether every part's points fall on points of the same part."""
    from scipy.spatial import cKDTree

    return all(
        bool((cKDTree(part.vertices).query(part.vertices @ rotation.T)[0] < SAME * reach).all())
        for part in parts
        for reach in [float(np.abs(part.vertices).max())]
    )
