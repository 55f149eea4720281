"""Objects in a list and in a bank: the same renderings, sizes and symmetries."""

import numpy as np
import torch

from moveit6d.geometry.crop import look_at
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.cuda_renderer import BankRenderer
from moveit6d.rendering.mesh_bank import MeshBank, pack_mesh
from moveit6d.synthesis.objects.object_set import BankObjects, MeshObjects
from tests.support.pairs import objects
from tests.support.rasterizer import compiled


def a_bank(shares: list[float]) -> BankObjects:
    meshes = objects()
    bank = MeshBank.of([pack_mesh(mesh) for mesh in meshes], torch.device("cpu"))
    numbers = range(len(meshes))
    return BankObjects(BankRenderer(bank, compiled()), [numbers[:1], numbers[1:]], shares)


def test_list_and_bank_agree() -> None:
    listed, banked = MeshObjects(list(objects())), a_bank([1.0, 1.0])
    index = torch.arange(len(objects()))
    assert torch.allclose(listed.diameters(index), banked.diameters(index))
    for number in index.tolist():
        assert np.allclose(listed.symmetries(number), banked.symmetries(number))
    ahead = torch.nn.functional.pad(4 * listed.diameters(index)[:, None], (2, 0))
    pose = Pose(torch.eye(3, dtype=torch.float64).expand(len(index), 3, 3), ahead)
    intrinsics = look_at(pose, listed.diameters(index)).intrinsics
    one, other = (kind.render(index, pose, intrinsics) for kind in (listed, banked))
    assert (one.mask != other.mask).float().mean() < 0.001
    assert (one.albedo - other.albedo).abs().mean() < 0.002


def test_groups_are_drawn_by_their_shares() -> None:
    drawn = a_bank([3.0, 1.0]).draw(np.random.default_rng(0), 2000)
    assert abs(float((drawn == 0).float().mean()) - 0.75) < 0.04
    assert set(drawn.tolist()) == set(range(len(objects())))


def test_sets_know_how_many_objects_are_drawn() -> None:
    assert len(MeshObjects(objects())) == len(a_bank([1.0, 1.0])) == len(objects())
