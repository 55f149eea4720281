"""Written pairs in the eight dihedral views: quarter turns of the patches, and their mirror images.

Never draws anything. A turned pair is what a camera that is rolled sees; a mirrored one shows an
object that is the mirror image of its mesh.
"""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from ...actions import mirror_delta, rotate_delta
from ...errors import InputError
from ...observation import mirrored, rotated
from .pairs import TrainingBatch


def dihedral_view(batch: TrainingBatch, quarters: int, mirror: bool) -> TrainingBatch:
    """The pairs turned by quarters as `observation.rotated` does, then mirrored if `mirror` is set.

    With `mirror`, `mesh` and `rotation` are those of the mirror images of the meshes about x = 0.
    Pairs with templates (`views`) are an `InputError`.
    """
    if batch.views is not None:
        raise InputError("Pairs with templates have no dihedral views.")
    observation = rotated(batch.observation, quarters)
    delta = rotate_delta(batch.delta, quarters)
    quarter = batch.rotation.new_tensor([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    roll = torch.linalg.matrix_power(quarter, quarters % 4)
    rotation = roll @ batch.rotation
    direction = batch.direction @ roll[:2, :2].mT.to(batch.direction)
    if mirror:
        observation, delta = mirrored(observation), mirror_delta(delta)
        flip = torch.diag(roll.new_tensor([-1.0, 1.0, 1.0]))
        rotation, direction = flip @ rotation @ flip, direction @ flip[:2, :2].to(direction)

    def shown(layer: Tensor) -> Tensor:
        layer = torch.rot90(layer, quarters, (2, 3))
        return layer.flip(3) if mirror else layer

    return replace(
        batch,
        observation=observation,
        delta=delta,
        true_depth=shown(batch.true_depth),
        true_mask=shown(batch.true_mask),
        clear=shown(batch.clear),
        rotation=rotation,
        direction=direction,
    )
