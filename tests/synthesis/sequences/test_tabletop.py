"""Objects beside each other: they move as one and hide each other, and poses are as seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch

from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from moveit6d.synthesis.imaging.shading import ShadedSurface
from moveit6d.synthesis.objects.demo_object import demo_object
from moveit6d.synthesis.sequences.difficulty import Difficulty
from moveit6d.synthesis.sequences.sequence import Scene, SyntheticFrame
from tests.support.meshes import colored_box

SMALL = Camera(205.0, 205.0, 106.0, 79.5, 213, 160)
STILL = Difficulty(
    "still", (1e-3, 2e-3), (1e-3, 2e-3), shutter=(0.01, 0.02), clutter=(0, 0), margin=2.6
)


@pytest.fixture(scope="module")
def others() -> list[Mesh]:
    return [colored_box((0.12, 0.1, 0.08), (0.3, 0, 0)), colored_box((0.2, 0.06, 0.06))]


@pytest.fixture(scope="module")
def robot() -> Mesh:
    return demo_object()


def poses(frame: SyntheticFrame) -> list[Pose]:
    return [frame.pose, *(pose for pose, _ in frame.others)]


def test_they_keep_their_places(robot: Mesh, others: list[Mesh]) -> None:
    scene = Scene(
        robot, 3, 12, replace(STILL, degrees_per_frame=(2, 3)), camera=SMALL, others=others
    )
    one, two = poses(scene.render_frame(1)), poses(scene.render_frame(9))
    moved = (one[0].matrix - two[0].matrix).abs().max()
    assert moved > 0.01
    for other in (1, 2):
        before, after = one[0].inverse() @ one[other], two[0].inverse() @ two[other]
        torch.testing.assert_close(before.matrix, after.matrix, atol=1e-9, rtol=0)


def test_poses_are_where_they_are_seen(
    robot: Mesh, others: list[Mesh], monkeypatch: pytest.MonkeyPatch
) -> None:
    def brightness(surface: ShadedSurface, *_: object) -> torch.Tensor:
        return torch.ones_like(surface.albedo)

    monkeypatch.setattr("moveit6d.synthesis.sequences.layers.shade", brightness)
    black = [np.zeros((80, 100, 3), np.uint8)]
    scene = Scene(robot, 5, 4, STILL, camera=SMALL, photos=black, others=others)
    frame = scene.render_frame(1)
    renderer, expected = make_renderer("embree"), np.zeros((160, 213), bool)
    for mesh, pose in zip([robot, *others], poses(frame), strict=True):
        inner = mesh.inner(pose)
        batch = Pose(inner.rotation[None], inner.translation[None])
        seen = renderer.render([mesh], batch, SMALL.matrix[None], 213).mask[0, 0].numpy()
        expected |= seen[:160] > 0.5
    bright = (frame.image[..., 1] / 255) ** 2.2 > 0.5
    assert (bright & expected).sum() / (bright | expected).sum() > 0.95


def test_they_hide_each_other(robot: Mesh, others: list[Mesh]) -> None:
    scene = Scene(robot, 5, 4, STILL, camera=SMALL, others=others)
    frame = scene.render_frame(1)
    seen = [frame.visible_fraction, *(fraction for _, fraction in frame.others)]
    depth = np.stack(
        [
            make_renderer("embree")
            .render([mesh], Pose(i.rotation[None], i.translation[None]), SMALL.matrix[None], 213)
            .depth[0, 0, :160]
            .numpy()
            for mesh, i in (
                (m, m.inner(p)) for m, p in zip([robot, *others], poses(frame), strict=True)
            )
        ]
    )
    # The slow way: of all pixels of an object in the frame, those where it is the nearest.
    nearest = np.where(depth > 0, depth, np.inf).argmin(0)
    inside = [float((nearest[depth[k] > 0] == k).mean()) for k in range(3)]
    np.testing.assert_allclose(seen, inside, atol=0.02)
