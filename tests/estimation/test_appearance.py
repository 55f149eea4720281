"""What a frame showed of an object, on renderings from elsewhere."""

import numpy as np
import pytest
import torch

from moveit6d.estimation.appearance import Appearance
from moveit6d.estimation.frame import prepare_frame
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.crop import look_at
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3
from moveit6d.rendering.renderer import GBuffer, Renderer, make_renderer
from moveit6d.rendering.shading import shade_plain
from tests.support.meshes import textured_box

CAMERA = Camera(400.0, 400.0, 159.5, 119.5, 320, 240)
SIZE = (0.1, 0.08, 0.06)


def box(seed: int) -> Mesh:
    """A box with coarse random squares on it."""
    squares = np.random.default_rng(seed).integers(30, 226, (6, 6, 3), dtype=np.uint8)
    return textured_box(np.kron(squares, np.ones((24, 24, 1), np.uint8)), SIZE)


def pose(turn: tuple[float, float, float], place: tuple[float, float, float]) -> Pose:
    return Pose(exp_so3(torch.tensor(turn).double()), torch.tensor(place).double())


def seen(mesh: Mesh, where: Pose, renderer: Renderer) -> tuple[torch.Tensor, GBuffer, object, Pose]:
    """The plain rendering at a pose, its buffer, its intrinsics and the virtual pose."""
    batch = Pose(where.rotation[None], where.translation[None])
    view = look_at(batch, torch.tensor([mesh.sphere_diameter]).double())
    virtual = view.to_virtual(batch)
    buffer = renderer.render([mesh], virtual, view.intrinsics)
    return shade_plain(buffer)[0], buffer, view.intrinsics[0], virtual[0]


def picture(mesh: Mesh, where: Pose, renderer: Renderer) -> np.ndarray:
    """A frame of the object at a pose, in its own colours without any shade, before grey."""
    batch = Pose(where.rotation[None], where.translation[None])
    matrix = CAMERA.matrix().clone()
    matrix[1, 2] += (320 - 240) / 2  # renderers make squares
    buffer = renderer.render([mesh], batch, matrix[None], 320)
    whole = buffer.albedo * buffer.mask + 0.5 * (1 - buffer.mask)
    rows = whole[0, :, 40:280]
    return (rows * 255).round().to(torch.uint8).permute(1, 2, 0).numpy()


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return make_renderer("embree")


def test_a_wrong_texture_is_replaced_by_what_was_seen(renderer: Renderer) -> None:
    real, scanned = box(0), box(1)
    where = pose((0.5, 0.6, 0.1), (0.01, -0.01, 0.45))
    frame = prepare_frame(picture(real, where, renderer), CAMERA)
    appearance = Appearance.of(frame, scanned, scanned.outer(where), renderer)
    there = pose((0.6, 0.5, 0.2), (-0.02, 0.01, 0.40))
    plain, buffer, intrinsics, virtual = seen(scanned, there, renderer)
    painted = appearance.paint(plain, buffer, intrinsics, virtual)
    _, truth, _, _ = seen(real, there, renderer)
    inside = truth.mask[0, 0] > 0
    before = (plain - truth.albedo[0]).abs()[:, inside].mean()
    after = (painted - truth.albedo[0]).abs()[:, inside].mean()
    assert after < 0.3 * before
    assert (painted * (1 - buffer.mask[0])).abs().max() == 0


def test_what_was_not_seen_becomes_as_bright_as_what_was(renderer: Renderer) -> None:
    mesh = box(0)
    where = pose((0.5, 0.2, 0.1), (0.0, 0.0, 0.45))
    frame = prepare_frame(picture(mesh, where, renderer) // 2, CAMERA)
    appearance = Appearance.of(frame, mesh, mesh.outer(where), renderer)
    there = pose((0.5, 1.0, 0.1), (0.0, 0.0, 0.45))  # another side comes into sight
    plain, buffer, intrinsics, virtual = seen(mesh, there, renderer)
    painted = appearance.paint(plain, buffer, intrinsics, virtual)
    ratio = (painted.sum(0) / plain.sum(0).clamp_min(1e-3))[buffer.mask[0, 0] > 0]
    # Plain renderings are darker where a side is turned away, the frame is half as bright.
    exact = ratio[(ratio - ratio.median()).abs() < 1e-3]
    assert len(exact) > 0.15 * len(ratio)  # one gain for the new side
    assert 0.4 < ratio.median() < 0.9


def test_nothing_in_sight_leaves_the_rendering_alone(renderer: Renderer) -> None:
    mesh = box(0)
    where = pose((0.0, 0.0, 0.0), (0.0, 0.0, 0.45))
    grey = prepare_frame(np.full((240, 320, 3), 90, np.uint8), CAMERA)
    appearance = Appearance.of(grey, mesh, mesh.outer(where), renderer)
    behind = pose((0.0, np.pi, 0.0), (0.0, 0.0, 0.45))
    plain, buffer, intrinsics, virtual = seen(mesh, behind, renderer)
    assert torch.equal(appearance.paint(plain, buffer, intrinsics, virtual), plain)
