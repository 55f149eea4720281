"""Meshes as slots of a bank: what is packed is what the mesh says."""

from collections.abc import Sequence

import numpy as np
import torch

from moveit6d.rendering.mesh_bank import MeshBank, PackedMesh, pack_mesh
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


def packed_of(faces: int, side: int, value: int) -> PackedMesh:
    """A mesh of so many faces and a texture of so many texels a side, all of one number."""
    return PackedMesh(
        np.full((faces, 9), value, np.float32),
        np.full((faces, 18), value, np.float32),
        np.full((side * side, 3), value, np.uint8),
        np.int32([[0, side, side]]) if side else np.zeros((0, 3), np.int32),
        False,
        1.0,
        float(value),
        np.eye(4)[None],
    )


def assert_holds(bank: MeshBank, meshes: Sequence[PackedMesh]) -> None:
    for slot, mesh in enumerate(meshes):
        face, texel = bank.places[slot].tolist()
        for there, wanted, first in (
            (bank.corners, mesh.corners, face),
            (bank.values, mesh.values, face),
            (bank.texels, mesh.texels, texel),
        ):
            assert np.array_equal(there[first : first + len(wanted)].numpy(), wanted)
        assert bank.meta[slot, :2].tolist() == [len(mesh.corners), len(mesh.levels)]
        assert float(bank.diameter[slot]) == mesh.sphere_diameter


def test_a_large_mesh_costs_no_other_s_room() -> None:
    meshes = [packed_of(12, 4, 1), packed_of(50_000, 512, 2), packed_of(20, 0, 3)]
    bank = MeshBank.of(meshes, torch.device("cpu"))
    assert len(bank.corners) == len(bank.values) == 50_032 and bank.most_faces == 50_000
    assert len(bank.texels) == 4 * 4 + 512 * 512
    assert_holds(bank, meshes)


def test_slots_are_filled_anew_with_meshes_of_any_size() -> None:
    random, slots = np.random.default_rng(0), 6
    bank = MeshBank(slots, torch.device("cpu"))
    held = [packed_of(0, 0, 1)] * slots
    most = 0
    for number in range(300):
        slot = int(random.integers(slots))
        held[slot] = packed_of(
            int(random.integers(1, 90)), int(random.integers(0, 9)), number % 250
        )
        bank.put(slot, held[slot])
        most = max(most, sum(len(mesh.corners) for mesh in held))
    assert_holds(bank, held)
    assert most <= len(bank.corners) <= 1.5 * most, "what is replaced gives its room back"
