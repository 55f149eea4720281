"""The nearest of a symmetric object's equivalent poses: what an expert would head for.

Never renders. No network is taught to turn a can whose turn nobody can see.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
import torch
from torch import Tensor

from ...actions import expert_delta, pose_delta
from ...geometry.crop import Crop
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose


def nearest_delta(
    meshes: Sequence[Mesh], start: Pose, goal: Pose, sphere_diameter: Tensor,
    crop: Crop = "look_at",
) -> Tensor:  # fmt: skip
    """Counts (B, 6) from centred poses (B) to the nearest equivalents of their goals.

    Those of `actions.difference` for objects that declare no symmetry. `sphere_diameter` (B,) in
    metres.
    """
    delta = pose_delta(start, goal, sphere_diameter, crop)
    for number, mesh in enumerate(meshes):
        if not mesh.symmetries.is_trivial:
            delta[number] = expert_delta(
                start[number],
                goal[number],
                sphere_diameter[number],
                centred_symmetries(mesh),
                crop,
            )
    return delta


@lru_cache(maxsize=128)
def centred_symmetries(mesh: Mesh) -> Tensor:
    """A mesh's symmetries (S, 4, 4) in its centred frame, the identity first."""
    motions = mesh.symmetries.transforms()
    moved = motions[:, :3, :3] @ mesh.center - mesh.center
    centred = motions.copy()
    centred[:, :3, 3] += moved
    return torch.from_numpy(np.ascontiguousarray(centred))
