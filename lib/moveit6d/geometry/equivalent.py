"""Which of a symmetric object's equivalent poses is nearest to another pose.

Never decides that an object is symmetric; see `Symmetries`.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray

from .pose import Pose
from .symmetry import ContinuousSymmetry, Symmetries


def nearest_equivalent(pose: Pose, reference: Pose, symmetries: Symmetries) -> Pose:
    """The equivalent of an unbatched pose that is turned least against `reference`.

    Both and the answer in the mesh file's frame, float64. Exact for axes too: the angle about an
    axis that turns least has a closed form.
    """
    if symmetries.is_trivial:
        return pose
    rotation = pose.rotation.to(torch.float64).numpy()
    between = reference.rotation.to(torch.float64).numpy().T @ rotation
    best, found = -math.inf, np.eye(4)
    for discrete in (np.eye(4), *symmetries.discrete):
        turned = discrete[:3, :3] @ between  # trace(between · axis · discrete), cyclically
        candidates = [discrete]
        candidates += [_about(axis, turned) @ discrete for axis in symmetries.continuous]
        for candidate in candidates:
            likeness = float(np.trace(between @ candidate[:3, :3]))
            if likeness > best + 1e-12:
                best, found = likeness, candidate
    shift = torch.from_numpy(rotation @ found[:3, 3])
    return Pose(torch.from_numpy(rotation @ found[:3, :3]), pose.translation + shift)


def _about(symmetry: ContinuousSymmetry, turned: NDArray[np.float64]) -> NDArray[np.float64]:
    """The turn C (4, 4) about the axis with the largest trace of turned · C."""
    along = symmetry.axis @ turned @ symmetry.axis
    return symmetry.turn(math.atan2(np.trace(turned @ symmetry.cross()), np.trace(turned) - along))
