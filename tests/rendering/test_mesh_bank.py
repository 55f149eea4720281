"""Meshes as slots of a bank: what is packed is what the mesh says."""

import numpy as np
import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.rendering.mesh_bank import MeshBank, pack_mesh
from moveit6d.synthesis.objects.symmetric_shapes import symmetric_object
from tests.support.meshes import square


def test_corners_colours_and_symmetries_are_the_mesh_s() -> None:
    colors = np.uint8([[255, 0, 0], [0, 255, 0], [0, 0, 255], [9, 8, 7]])
    mesh = square(colors=colors)
    packed = pack_mesh(mesh)
    assert np.array_equal(packed.corners.reshape(-1, 3, 3), mesh.vertices[mesh.faces])
    assert np.array_equal(packed.values.reshape(-1, 3, 6)[..., 3:], colors[mesh.faces])
    assert len(packed.texels) == 0 and len(packed.symmetries) == 1
    round_one = symmetric_object(np.random.default_rng(0))
    assert len(pack_mesh(round_one).symmetries) == len(round_one.symmetries.transforms())
    assert len(pack_mesh(round_one).texels) > 0


def test_a_mesh_that_is_too_large_for_a_slot_is_refused() -> None:
    packed = pack_mesh(square(colors=np.zeros((4, 3), np.uint8)))
    bank = MeshBank(1, 1, 1, torch.device("cpu"))
    assert not bank.fits(packed)
    with pytest.raises(InputError, match="does not fit a slot"):
        bank.put(0, packed)
