"""The OpenGL back end against the ray caster, and what it says where there is no OpenGL."""

import ctypes.util
import gc
import os
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch

from moveit6d.errors import RenderingUnavailable
from moveit6d.geometry.pose import Pose
from moveit6d.rendering import available_renderers, make_renderer
from moveit6d.rendering import pyrender_backend as backend
from tests.support import meshes


@pytest.fixture(scope="module")
def renderer():
    try:
        return make_renderer("pyrender")
    except RenderingUnavailable as error:
        pytest.skip(str(error))


def texture():
    return np.random.default_rng(0).integers(0, 255, (64, 64, 3), dtype=np.uint8)


MESHES = {
    "coloured box": meshes.colored_box,
    "L": meshes.l_shape,
    "sphere": lambda: meshes.sphere(subdivisions=4),
    "textured box": lambda: meshes.textured_box(texture()),
    "sheet": meshes.square,
}


@pytest.mark.parametrize("kind", MESHES)
@pytest.mark.parametrize("seed", range(3))
def test_it_agrees_with_embree(renderer, kind, seed):
    mesh = MESHES[kind]()
    pose, intrinsics = meshes.view(mesh, seed, offset=(0.003, -0.002))
    intrinsics[0, 0, 1], intrinsics[0, 1, 1] = 20.0, 1.05 * intrinsics[0, 1, 1]
    one = make_renderer("embree").render([mesh], pose, intrinsics)
    other = renderer.render([mesh], pose, intrinsics)
    # The same pixels, but for the few whose centre lies on the outline to a rounding error.
    assert (one.mask != other.mask).sum() <= 3
    both = ((one.mask > 0) & (other.mask > 0))[0, 0]
    assert both.sum() > 500
    apart = (one.depth - other.depth).abs()[0, 0][both]
    assert (apart > 1e-3).sum() <= 3  # at edges within the outline
    assert apart.median() < 1e-6
    same = apart < 1e-3
    turned = (one.normal - other.normal).norm(dim=1)[0][both][same]
    assert (turned > 1e-3).sum() <= 3  # edges of a box meet at equal depth
    colored = (one.albedo - other.albedo).abs().amax(1)[0][both][same]
    assert (colored > 2 / 255).sum() <= 0.005 * both.sum() + 3


def test_batches_sizes_and_meshes_that_come_and_go(renderer):
    embree = make_renderer("embree")
    for size in (64, 128, 32):
        parts = [meshes.colored_box(), meshes.l_shape()]
        views = [meshes.view(mesh, seed, size=size) for seed, mesh in enumerate(parts)]
        poses = Pose(*(torch.cat([getattr(p, n) for p, _ in views]) for n in vars(views[0][0])))
        intrinsics = torch.cat([k for _, k in views])
        one = embree.render(parts, poses, intrinsics, size)
        other = renderer.render(parts, poses, intrinsics, size)
        assert other.normal.shape == (2, 3, size, size)
        assert (one.mask != other.mask).sum() <= 4
        del parts, views
        gc.collect()
    assert len(renderer._nodes) == 0


def test_threads_may_take_turns(renderer):
    mesh = meshes.colored_box()
    pose, intrinsics = meshes.view(mesh)
    here = renderer.render([mesh], pose, intrinsics)
    with ThreadPoolExecutor(2) as pool:
        tasks = [pool.submit(renderer.render, [mesh], pose, intrinsics) for _ in range(4)]
        there = [task.result() for task in tasks]
    there.append(renderer.render([mesh], pose, intrinsics))
    assert all(torch.equal(one.albedo, here.albedo) for one in there)


@pytest.mark.parametrize("place", [(0, 0, -0.7), (5.0, 0, 0.7)])
def test_out_of_sight_is_empty(renderer, place):
    mesh = meshes.colored_box()
    pose, intrinsics = meshes.view(mesh)
    pose = Pose(pose.rotation, torch.tensor([place], dtype=torch.float64))
    buffer = renderer.render([mesh], pose, intrinsics)
    for value in (buffer.albedo, buffer.normal, buffer.depth, buffer.mask):
        assert (value == 0).all()


def test_the_environment_is_left_as_it_was(renderer, monkeypatch):
    mesh = meshes.colored_box()
    pose, intrinsics = meshes.view(mesh)
    for value in (None, "something"):
        if value is None:
            monkeypatch.delenv(backend.VARIABLE, raising=False)
        else:
            monkeypatch.setenv(backend.VARIABLE, value)
        before = dict(os.environ)
        renderer.render([mesh], pose, intrinsics)
        assert dict(os.environ) == before


# Without OpenGL


@pytest.fixture
def bare_machine(monkeypatch):
    """A machine without EGL, OSMesa and display, and a process that has not looked yet."""
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: None)
    monkeypatch.setattr(backend.sys, "platform", "linux")
    monkeypatch.setattr(backend, "_open", backend._open.__wrapped__)
    for variable in ("DISPLAY", backend.VARIABLE):
        monkeypatch.delenv(variable, raising=False)


def test_missing_libraries_are_named_with_their_packages(bare_machine):
    with pytest.raises(RenderingUnavailable, match=r"libegl1 and libgl1.*libosmesa6.*embree"):
        make_renderer("pyrender")


def test_doctor_learns_which_back_ends_work(bare_machine):
    reasons = available_renderers()
    assert list(reasons) == ["embree", "pyrender"]
    assert reasons["embree"] is None
    assert "libegl1" in reasons["pyrender"]


def test_a_platform_that_fails_is_named(bare_machine, monkeypatch):
    monkeypatch.setenv(backend.VARIABLE, "nonsense")
    with pytest.raises(RenderingUnavailable, match=r"through nonsense.*libegl1"):
        make_renderer("pyrender")
    assert os.environ[backend.VARIABLE] == "nonsense"


def test_the_order_is_egl_osmesa_window(bare_machine, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":0")
    assert backend._platform() == "window"
    monkeypatch.setattr(ctypes.util, "find_library", lambda name: f"lib{name}-none.so")
    assert backend._platform() == "osmesa"  # an EGL that cannot be loaded does not count
    monkeypatch.setattr(backend, "_egl_has_device", lambda: True)
    assert backend._platform() == "egl"
    monkeypatch.setenv(backend.VARIABLE, "osmesa")
    assert backend._platform() == "osmesa"
