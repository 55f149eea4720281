"""The nearest of a symmetric object's equivalent poses, which training aims at.

Never renders. No network learns a rotation of a can that no image shows.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...actions import pose_delta
from ...geometry.crop import Crop
from ...geometry.pose import Pose


def nearest_delta(
    symmetries: Sequence[NDArray[np.float64]], start: Pose, goal: Pose, sphere_diameter: Tensor,
    crop: Crop = "look_at",
) -> Tensor:  # fmt: skip
    """Pose deltas (B, 6) from centred poses (B) to the nearest equivalents of their goals.

    `symmetries` are each object's motions (S, 4, 4) of its centred frame, the identity first; the
    choice is the shortest pose delta, as in `actions.expert_delta`. `sphere_diameter` (B,)
    in metres.
    """
    delta = pose_delta(start, goal, sphere_diameter, crop)
    several = [number for number, motions in enumerate(symmetries) if len(motions) > 1]
    if not several:
        return delta
    device = delta.device
    motions, row = equivalents([symmetries[number] for number in several], device)
    chosen = torch.tensor(several, device=device)
    owner = chosen[row]
    goals = goal[owner] @ Pose.from_matrix(motions)
    each = pose_delta(start[owner], goals, sphere_diameter[owner], crop)
    length = each.norm(dim=-1)
    least = length.new_full((len(several),), torch.inf).scatter_reduce(0, row, length, "amin")
    place = torch.arange(len(each), device=device)
    best = torch.where(length <= least[row], place, len(each))
    first = torch.full_like(chosen, len(each)).scatter_reduce(0, row, best, "amin")
    delta[chosen] = each[first.clamp_max(len(each) - 1)]
    return delta


def equivalents(
    symmetries: Sequence[NDArray[np.float64]], device: torch.device
) -> tuple[Tensor, Tensor]:
    """All motions (N, 4, 4) one after another, and whose each is (N,)."""
    motions = torch.from_numpy(np.concatenate(symmetries)).to(device)
    number = torch.tensor([len(some) for some in symmetries])
    row = torch.repeat_interleave(torch.arange(len(symmetries)), number).to(device)
    return motions, row


def rotation_distance(
    symmetries: Sequence[NDArray[np.float64]], one: Tensor, other: Tensor
) -> Tensor:
    """Degrees (B,) between rotations (B, 3, 3), the other by its nearest equivalent."""
    motions, row = equivalents(symmetries, one.device)
    between = one[row].mT @ other[row] @ motions[:, :3, :3]
    cosine = ((between.diagonal(dim1=-2, dim2=-1).sum(-1) - 1) / 2).clamp(-1, 1)
    angle = torch.rad2deg(torch.arccos(cosine))
    return angle.new_full((len(symmetries),), torch.inf).scatter_reduce(0, row, angle, "amin")
