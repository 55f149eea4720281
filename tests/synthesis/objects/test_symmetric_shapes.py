"""Made objects that declare symmetries look the same after them; others declare none."""

import numpy as np
import pytest

from moveit6d.geometry.pose import Pose
from moveit6d.rendering.embree import EmbreeRenderer
from moveit6d.synthesis.objects import primitives as make
from moveit6d.synthesis.objects import shapes
from moveit6d.synthesis.objects.part_symmetries import plain_symmetries
from moveit6d.synthesis.objects.symmetric_shapes import symmetric_object
from moveit6d.synthesis.training.equivalents import centred_symmetries
from tests.support.meshes import view


@pytest.mark.parametrize("seed", range(8))
def test_the_declared_symmetries_cannot_be_seen(seed: int) -> None:
    mesh = symmetric_object(np.random.default_rng(seed))
    assert not mesh.symmetries.is_trivial
    motions = Pose.from_matrix(centred_symmetries(mesh))
    count = len(motions.translation)
    # Of a body turned on a lathe of 32 corners only those turns that take corners to corners.
    chosen = [1, count // 2] if not mesh.symmetries.continuous else [0, count // 32]
    pose, intrinsics = view(mesh, seed)
    poses = Pose.stack([pose[0], *(pose[0] @ motions[k] for k in chosen)])
    seen = EmbreeRenderer().render([mesh] * 3, poses, intrinsics.expand(3, 3, 3), 64)
    for other in (1, 2):
        assert (seen.mask[0] != seen.mask[other]).float().mean() < 0.01
        both = (seen.mask[0] * seen.mask[other])[0] > 0.5
        off = (seen.depth[0] - seen.depth[other])[0, both].abs() / mesh.sphere_diameter
        assert off.quantile(0.98) < 0.02
        tint = (seen.albedo[0] - seen.albedo[other])[:, both].abs().amax(0)
        assert tint.quantile(0.95) < 0.1


def test_the_same_seed_gives_the_same_object() -> None:
    first, again = (symmetric_object(np.random.default_rng(3)) for _ in range(2))
    assert np.array_equal(first.vertices, again.vertices)
    assert np.array_equal(first.symmetries.discrete, again.symmetries.discrete)


def test_bodies_have_the_groups_that_books_give_them() -> None:
    assert len(plain_symmetries([make.box((1.0, 2.0, 3.0))]).discrete) == 3
    assert len(plain_symmetries([make.box((1.0, 1.0, 3.0))]).discrete) == 7
    assert len(plain_symmetries([make.box((1.0, 1.0, 1.0))]).discrete) == 23
    turned = plain_symmetries([make.cylinder(0.5, 1.0)])
    assert len(turned.continuous) == 1 and len(turned.discrete) == 1
    cone = plain_symmetries([make.lathe(np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0]))])
    assert len(cone.continuous) == 1 and len(cone.discrete) == 0
    stacked = [make.box((2.0, 2.0, 1.0)), make.box((0.5, 0.5, 0.5)).moved((0.3, 0.1, 0.7), 1)]
    assert plain_symmetries(stacked).is_trivial


def test_random_objects_declare_something_only_if_they_are_plain(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(shapes, "FAMILIES", (lambda rng: [make.box((1.0, 2.0, 3.0))],))
    random = np.random.default_rng(4)
    found = [shapes.random_object(random) for _ in range(24)]
    declared = [mesh for mesh in found if not mesh.symmetries.is_trivial]
    assert 0 < len(declared) < 9
    for mesh in declared:
        assert mesh.texture is not None and np.ptp(mesh.texture, axis=(0, 1)).max() < 70
        shift = centred_symmetries(mesh)[:, :3, 3]
        assert shift.abs().max() < 1e-3 * mesh.sphere_diameter, "about the box's own middle"
