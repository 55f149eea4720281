"""Drawn poses: the outline sits on the silhouette, through lenses too; nothing else changes."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from moveit6d.rendering.renderer import Renderer
from moveit6d.visualization.overlay import GREEN, RED, blank, draw_pose, draw_text, outlines


@pytest.fixture(scope="module")
def renderer() -> Renderer:
    return make_renderer()


def hull_of_projected_vertices(mesh: Mesh, pose: Pose, camera: Any) -> np.ndarray:
    import cv2

    points = mesh.inner(pose).transform(torch.from_numpy(mesh.vertices).double()).numpy()
    lens = np.array(camera.distortion or [0.0] * 5)
    zero = np.zeros(3)
    pixels, _ = cv2.projectPoints(points, zero, zero, camera.matrix.numpy(), lens)
    return np.asarray(cv2.convexHull(pixels[:, 0].astype(np.float32)))


@pytest.mark.parametrize("distortion", [None, (0.3, -0.1, 0.01, -0.02, 0.0)])
@pytest.mark.parametrize("place", [(0.0, 0.0, 0.5), (-0.15, 0.09, 0.45), (0.02, 0.0, 2.0)])
def test_the_outline_is_the_projected_silhouette(
    scene: Any,
    renderer: Renderer,
    distortion: tuple[float, ...] | None,
    place: tuple[float, float, float],
) -> None:
    import cv2

    camera = replace(scene.camera, distortion=distortion)
    pose = Pose(scene.pose(0).rotation, torch.tensor(place, dtype=torch.float64))
    hull = hull_of_projected_vertices(scene.mesh, pose, camera)
    (closed,) = outlines(scene.mesh, pose, camera, renderer)
    pixels = closed / 16
    # The brick is convex; its outline runs along the outermost pixels, half a pixel inside.
    distance = [cv2.pointPolygonTest(hull, (float(x), float(y)), True) for x, y in pixels]
    assert max(map(abs, distance)) < 1.5 and abs(float(np.mean(distance))) < 0.8
    drawn = cv2.contourArea(pixels.astype(np.float32))
    assert drawn == pytest.approx(cv2.contourArea(hull), rel=0.12)


def test_holes_are_outlined(renderer: Renderer, scene: Any) -> None:
    import trimesh

    ring = trimesh.creation.annulus(0.02, 0.05, 0.01)
    mesh = Mesh.from_arrays("ring", ring.vertices, ring.faces)
    pose = Pose(torch.eye(3, dtype=torch.float64), torch.tensor([0.0, 0.0, 0.4]).double())
    found = sorted(outlines(mesh, pose, scene.camera, renderer), key=len)
    assert len(found) == 2
    widths = [np.ptp(closed[:, 0]) / 16 for closed in found]
    assert widths[0] == pytest.approx(0.04 / 0.4 * 180, abs=3)
    assert widths[1] == pytest.approx(0.10 / 0.4 * 180, abs=3)


def test_every_kind_of_image_and_pose_is_drawn_alike(renderer: Renderer, scene: Any) -> None:
    image, pose = scene.image(0), scene.pose(0)
    drawn = draw_pose(image, scene.mesh, pose, scene.camera, renderer)
    kinds = [(image, pose.matrix.numpy()), (Image.fromarray(image), pose), (image / 255, pose)]
    for picture, place in kinds:
        again = draw_pose(picture, scene.mesh, place, scene.camera, renderer)
        assert again.dtype == np.uint8
        np.testing.assert_array_equal(again, drawn)
    grey = draw_pose(image[..., 0], scene.mesh, pose, scene.camera, renderer)
    assert grey.shape == image.shape


def test_an_image_of_another_size_is_refused(renderer: Renderer, scene: Any) -> None:
    with pytest.raises(InputError, match="is 80×60 but the camera is 160×120"):
        draw_pose(scene.image(0)[::2, ::2], scene.mesh, scene.pose(0), scene.camera, renderer)
    with pytest.raises(InputError, match="pose must be a Pose or a 4×4 matrix, found NoneType"):
        draw_pose(scene.image(0), scene.mesh, None, scene.camera, renderer)  # type: ignore[arg-type]


def test_an_object_behind_the_camera_is_not_drawn(renderer: Renderer, scene: Any) -> None:
    behind = Pose(scene.pose(0).rotation, torch.tensor([0.0, 0.0, -0.5], dtype=torch.float64))
    image = scene.image(0)
    assert outlines(scene.mesh, behind, scene.camera, renderer) == []
    drawn = draw_pose(image, scene.mesh, behind, scene.camera, renderer)
    np.testing.assert_array_equal(drawn, image)


def test_an_object_half_outside_or_around_the_camera_can_be_drawn(
    renderer: Renderer, scene: Any
) -> None:
    image = scene.image(0)
    for place in ((0.3, 0.0, 0.4), (0.0, 0.0, 0.03), (5.0, 5.0, 0.1)):
        pose = Pose(scene.pose(0).rotation, torch.tensor(place, dtype=torch.float64))
        drawn = draw_pose(image, scene.mesh, pose, scene.camera, renderer)
        assert drawn.shape == image.shape


def test_drawing_leaves_the_frame_and_what_is_far_from_the_object_alone(
    renderer: Renderer, scene: Any
) -> None:
    image = scene.image(0)
    before = image.copy()
    drawn = draw_pose(image, scene.mesh, scene.pose(0), scene.camera, renderer, color=RED)
    np.testing.assert_array_equal(image, before)
    changed = np.argwhere((drawn != image).any(-1))
    x, y = scene.camera.project(scene.mesh.inner(scene.pose(0)).translation).tolist()
    reach = scene.mesh.sphere_diameter / 2 / 0.4 * 180
    distance = np.hypot(changed[:, 1] - x, changed[:, 0] - y)
    assert len(changed) > 0 and distance.max() < reach + 4
    assert (drawn == RED).all(-1).any(), "the outline has the colour asked for"


def test_axes_point_along_the_objects_axes(renderer: Renderer, scene: Any) -> None:
    turn = torch.eye(3, dtype=torch.float64)  # x to the right, y down
    pose = Pose(turn, torch.tensor([-0.03, 0.01, 0.5], dtype=torch.float64))
    plain = draw_pose(blank(scene.camera), scene.mesh, pose, scene.camera, renderer, axes=False)
    drawn = draw_pose(blank(scene.camera), scene.mesh, pose, scene.camera, renderer)
    x, y = scene.camera.project(scene.mesh.inner(pose).translation).tolist()
    added = (drawn.astype(int) - plain).clip(0)
    red = np.argwhere((added[..., 0] > 150) & (added[..., 1] < 120)).mean(0)
    green = np.argwhere((added[..., 1] > 150) & (added[..., 0] < 120)).mean(0)
    assert math.isclose(red[0], y, abs_tol=2) and red[1] > x + 5
    assert math.isclose(green[1], x, abs_tol=2) and green[0] > y + 5


def test_text_is_written_at_the_bottom(scene: Any) -> None:
    image = np.full((120, 160, 3), 100, np.uint8)
    drawn = draw_text(image, "frame 7", GREEN)
    changed = np.argwhere((drawn != image).any(-1))
    assert changed[:, 0].min() > 90 and (drawn == GREEN).all(-1).any()


def test_blank_has_the_cameras_size(scene: Any) -> None:
    assert blank(scene.camera).shape == (120, 160, 3) and not blank(scene.camera).any()
