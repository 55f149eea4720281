"""Objects that lie around another one and move with it, as on a table seen by a moving camera.

Never renders. They keep their places to each other; only the camera's view of them changes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ..objects.primitives import rotation
from .motion import Motion

ELEVATION = (20.0, 45.0)  # degrees above the table from which it is seen in the middle of the clip
APART = 0.46  # of the two diameters' sum: round things would overlap a little, others do not


@dataclass(frozen=True)
class TabletopObject:
    """An object at a fixed pose relative to the moving one; a `MovingOccluder` for the others."""

    mesh: Mesh
    motion: Motion
    place: Pose  # of this centred object in the other one's centred frame
    kind: str = "object"

    def present(self, frame: float) -> bool:
        """Always."""
        return True

    def pose(self, time: float) -> Pose:
        """The centred pose at a moment."""
        return self.motion.pose(time) @ self.place

    def poses(self, times: NDArray[np.float64]) -> Pose:
        """The centred poses at the moments (B,)."""
        return Pose.stack([self.pose(float(time)) for time in times])


def arrange_around(
    rng: np.random.Generator, mesh: Mesh, others: Sequence[Mesh], motion: Motion, frames: int
) -> list[TabletopObject]:
    """Places for the `others` in a ring around `mesh`, on a plane seen from above, each turned."""
    if not others:
        return []
    height = np.radians(rng.uniform(*ELEVATION))
    up = np.array([0.0, -np.cos(height), -np.sin(height)])  # camera frame
    side = np.array([1.0, 0.0, 0.0])
    back = np.cross(up, side)
    first = motion.rotation((frames - 1) / 2).mT
    start, step = rng.uniform(0, 2 * np.pi), 2 * np.pi / len(others)
    placed = []
    for number, other in enumerate(others):
        angle = start + number * step + rng.uniform(-0.1, 0.1) * step
        reach = APART * (mesh.sphere_diameter + other.sphere_diameter)
        offset = reach * (np.cos(angle) * side + np.sin(angle) * back)
        turned = first @ torch.from_numpy(rotation(rng))
        place = Pose(turned, first @ torch.from_numpy(offset))
        placed.append(TabletopObject(other, motion, place))
    return placed
