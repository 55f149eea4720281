"""The GPU's rasteriser against ray casting: the same surfaces, colours and normals."""

import numpy as np
import pytest
import torch

from moveit6d.errors import RenderingUnavailable
from moveit6d.geometry.crop import look_at
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import random_rotations
from moveit6d.rendering import cuda_renderer
from moveit6d.rendering.cuda_renderer import BankRenderer
from moveit6d.rendering.embree import EmbreeRenderer
from moveit6d.rendering.mesh_bank import MeshBank, pack_mesh
from moveit6d.synthesis.objects.occluders import hand
from moveit6d.synthesis.objects.shapes import random_object
from tests.support.meshes import square
from tests.support.rasterizer import compiled


@pytest.fixture(scope="module")
def meshes() -> list[Mesh]:
    """Textured shapes, a hand, and a square of vertex colours."""
    random = np.random.default_rng(0)
    corners = np.uint8([[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 0]])
    shapes = [random_object(random) for _ in range(3)]
    return [*shapes, hand(random).mesh, square(colors=corners)]


def test_it_draws_what_rays_see(meshes: list[Mesh]) -> None:
    bank = MeshBank.of([pack_mesh(mesh) for mesh in meshes], torch.device("cpu"))
    slots = torch.arange(10) % len(meshes)
    diameter = bank.diameter[slots]
    generator = torch.Generator().manual_seed(0)
    ahead = torch.zeros(10, 3, dtype=torch.float64)
    ahead[:, 2] = diameter * (1.6 + 6 * torch.rand(10, generator=generator, dtype=torch.float64))
    pose = Pose(random_rotations(10, generator), ahead)
    intrinsics = look_at(pose, diameter).intrinsics
    found = BankRenderer(bank, compiled()).render(slots, pose, intrinsics)
    wanted = EmbreeRenderer().render([meshes[k] for k in slots], pose, intrinsics)
    assert (found.mask != wanted.mask).sum() < 0.002 * wanted.mask.sum(), "but for the outline"
    both = (found.mask * wanted.mask)[:, 0] > 0.5
    assert both.sum() > 5000
    for name, most in (("depth", 1e-3), ("albedo", 0.02), ("normal", 0.01)):
        apart = (getattr(found, name) - getattr(wanted, name)).abs().amax(1)[both]
        assert apart.quantile(0.99) < most, name


def test_slots_can_be_filled_anew(meshes: list[Mesh]) -> None:
    packed = sorted(map(pack_mesh, meshes), key=lambda one: len(one.corners) + len(one.texels))
    bank = MeshBank.of(packed[:3], torch.device("cpu"))
    bank.put(1, packed[4])  # larger than what was there
    bank.put(0, packed[3])
    bank.put(1, packed[1])
    wanted = MeshBank.of([packed[3], packed[1], packed[2]], torch.device("cpu"))
    ahead = torch.nn.functional.pad(4 * wanted.diameter[:, None], (2, 0))
    pose = Pose(torch.eye(3, dtype=torch.float64).expand(3, 3, 3), ahead)
    intrinsics = look_at(pose, wanted.diameter).intrinsics
    one, other = (
        BankRenderer(some, compiled()).render(torch.arange(3), pose, intrinsics)
        for some in (bank, wanted)
    )
    assert (one.mask.sum((1, 2, 3)) > 100).all()
    for name in ("mask", "depth", "albedo", "normal"):
        assert torch.equal(getattr(one, name), getattr(other, name)), name


def test_without_cupy_a_sentence_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "cupy", None)
    bank = MeshBank(1, torch.device("cpu"))
    with pytest.raises(RenderingUnavailable, match="CuPy"):
        cuda_renderer.BankRenderer(bank)
