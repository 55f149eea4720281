"""Procedural objects are usable meshes, repeatable, varied, and quick to make."""

from __future__ import annotations

import time
from functools import cache

import numpy as np
import pytest

from moveit6d.geometry.mesh import Mesh
from moveit6d.synthesis.objects.demo_object import demo_object
from moveit6d.synthesis.objects.shapes import FAMILIES, SIZES, TEXTURE, random_object


@cache
def objects(count: int) -> list[Mesh]:
    return [random_object(np.random.default_rng(seed)) for seed in range(count)]


def test_random_objects_are_textured_meshes_of_the_promised_size() -> None:
    for mesh in objects(40):
        extent = np.ptp(mesh.vertices, axis=0).max()
        assert SIZES[0] * 0.999 <= extent <= SIZES[1] * 1.001
        assert mesh.texture is not None and mesh.texture.shape == (TEXTURE, TEXTURE, 3)
        assert mesh.uv is not None and mesh.uv.min() >= 0 and mesh.uv.max() <= 1
        assert 100 < len(mesh.faces) < 8000
        assert np.isfinite(mesh.normals).all()


def test_objects_stand_off_their_frames_origin() -> None:
    assert np.mean([np.linalg.norm(mesh.center) > 0.005 for mesh in objects(20)]) > 0.8


def test_same_seed_same_object_other_seed_another() -> None:
    first, again, other = (random_object(np.random.default_rng(seed)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(first.vertices, again.vertices)
    np.testing.assert_array_equal(first.texture, again.texture)
    assert first.vertices.shape != other.vertices.shape or (first.vertices != other.vertices).any()


def test_every_family_occurs() -> None:
    names = {mesh.name for mesh in objects(40)}
    assert names == {family.__name__.strip("_") for family in FAMILIES}


def test_photos_become_prints() -> None:
    loud = np.full((60, 80, 3), (255, 0, 255), np.uint8)  # a colour that no palette has
    share = [
        np.mean(np.abs(mesh.texture.astype(int) - (255, 0, 255)).sum(-1) < 60)
        for seed in range(30)
        if (mesh := random_object(np.random.default_rng(seed), [loud])).texture is not None
    ]
    assert max(share) > 0.3
    assert min(share) < 0.01


def test_an_object_takes_a_tenth_of_a_second() -> None:
    random_object(np.random.default_rng(0))  # imports and fonts
    begin = time.process_time()
    for seed in range(20):
        random_object(np.random.default_rng(seed))
    assert (time.process_time() - begin) / 20 < 0.3  # about 0.05 on a free core


def test_demo_object_is_the_same_each_time_and_unlike_itself_from_the_back() -> None:
    first, again = demo_object(), demo_object()
    np.testing.assert_array_equal(first.vertices, again.vertices)
    np.testing.assert_array_equal(first.texture, again.texture)
    assert first.diameter == pytest.approx(0.2222, abs=1e-3)
    lowest = first.vertices[:, 2].min() + first.center[2]
    assert lowest == pytest.approx(0.0, abs=1e-4)  # it stands on z = 0
