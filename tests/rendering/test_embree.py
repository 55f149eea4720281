"""Ray casting against independent truths: OpenCV's projection and closed forms."""

import sys

import cv2
import numpy as np
import pytest
import torch

from moveit6d.errors import RenderingUnavailable
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from tests.support import meshes
from tests.support.drawing import RENDERER, arrays, checkerboard, draw


def cv2_pixels(points, pose, intrinsics):
    """Pixels (N, 2) and depths (N,) of points by OpenCV."""
    turn, place = pose.rotation[0].numpy(), pose.translation[0].numpy()
    points = np.asarray(points, np.float64)
    pixels, _ = cv2.projectPoints(
        points, cv2.Rodrigues(turn)[0], place, intrinsics[0].numpy(), None
    )
    return pixels[:, 0], (points @ turn.T + place)[:, 2]


def inside_by(hull, size):
    """Signed distance (H, W) in pixels of each pixel's centre from a convex outline, + inside."""
    hull = hull.astype(np.float32).reshape(-1, 1, 2)
    return np.array(
        [[cv2.pointPolygonTest(hull, (x, y), True) for x in range(size)] for y in range(size)]
    )


@pytest.mark.parametrize("seed", range(4))
def test_outline_is_opencv_s_to_a_fraction_of_a_pixel(seed):
    mesh = meshes.l_shape()
    pose, intrinsics = meshes.view(mesh, seed, offset=(0.004, -0.003))
    mask = arrays(RENDERER.render([mesh], pose, intrinsics))[3]
    parts = [mesh.vertices[:24], mesh.vertices[24:]]  # two boxes, each convex
    distance = np.maximum(
        *(
            inside_by(cv2.convexHull(cv2_pixels(part, pose, intrinsics)[0].astype(np.float32)), 128)
            for part in parts
        )
    )
    assert (mask[distance > 0.02] == 1).all()  # the union's outline, a pixel's centre in or out
    assert (mask[distance < -0.02] == 0).all()
    assert 1000 < mask.sum() < 8000


@pytest.mark.parametrize("seed", range(4))
def test_depth_is_opencv_s_at_visible_vertices(seed):
    mesh = meshes.sphere(subdivisions=4)
    pose, intrinsics = meshes.view(mesh, seed)
    depth = arrays(RENDERER.render([mesh], pose, intrinsics))[2]
    pixels, z = cv2_pixels(mesh.vertices, pose, intrinsics)
    front = z < z.min() + 0.15 * (z.max() - z.min())  # the part that is not too steep
    x, y = pixels[front].astype(np.float32).T
    between = cv2.remap(depth, x[:, None], y[:, None], cv2.INTER_LINEAR)[:, 0]
    assert front.sum() > 100
    assert np.abs(between - z[front]).max() < 2e-4  # m, at 0.7 m; the curve within a pixel


@pytest.mark.parametrize(("seed", "distance"), [(0, 0.7), (1, 0.15), (2, 30.0)])
def test_depth_of_a_box_is_the_slab_formula_s(seed, distance):
    extents = np.array((0.1, 0.06, 0.04))
    mesh = meshes.colored_box(extents)
    pose, intrinsics = meshes.view(mesh, seed, distance=distance)
    depth = arrays(RENDERER.render([mesh], pose, intrinsics))[2]
    grid = np.stack(np.meshgrid(np.arange(128), np.arange(128)), -1).reshape(-1, 2)
    rays = np.c_[grid, np.ones(len(grid))] @ np.linalg.inv(intrinsics[0].numpy()).T
    turn, place = pose.rotation[0].numpy(), pose.translation[0].numpy()
    origin, towards = -place @ turn, rays @ turn
    ends = np.stack([(sign * extents / 2 - origin) / towards for sign in (-1, 1)])
    enter, leave = ends.min(0).max(1), ends.max(0).min(1)
    surely = leave - enter > 1e-6
    expected = np.where(surely, enter, 0).reshape(128, 128)
    clear = (np.abs(leave - enter) > 1e-5).reshape(128, 128)
    np.testing.assert_allclose(depth[clear], expected[clear], atol=2e-6 * max(1, distance))


@pytest.mark.parametrize(("edge", "first"), [(40.25, 41), (39.75, 40), (40.0 + 0.02, 41)])
def test_pixel_zero_is_the_centre_of_the_top_left_pixel(edge, first):
    # The sheet's left and top edges are put at this pixel; the next centre to the right is inside.
    mesh = meshes.square(0.1)
    pose = Pose(torch.eye(3)[None], torch.tensor([[0.0, 0.0, 1.0]]))
    centre = edge + 300 * 0.05
    intrinsics = torch.tensor([[[300.0, 0, centre], [0, 300, centre], [0, 0, 1]]])
    mask = arrays(RENDERER.render([mesh], pose, intrinsics))[3]
    assert np.flatnonzero(mask.any(0))[0] == first
    assert np.flatnonzero(mask.any(1))[0] == first


@pytest.mark.parametrize("seed", range(3))
def test_winding_does_not_matter(seed):
    vertices, faces, _, colors = meshes.box_arrays()
    mesh = meshes.colored_box()
    inverted = Mesh.from_arrays("inverted", vertices, faces[:, ::-1], vertex_colors=colors)
    for one, other in zip(draw(mesh, seed), draw(inverted, seed), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-5)


def test_a_sheet_is_seen_from_both_sides():
    mesh = meshes.square()
    pose, intrinsics = meshes.view(mesh)
    half_turn = torch.diag(torch.tensor([1.0, -1, -1], dtype=torch.float64))[None]
    for turn in (pose.rotation, half_turn):
        seen = Pose(turn, pose.translation)
        _, normal, _, mask = arrays(RENDERER.render([mesh], seen, intrinsics))
        assert mask.sum() > 3000
        np.testing.assert_allclose(normal[mask > 0][:, 2], -1, atol=1e-6)


def towards(axis, sign):
    """The rotation (1, 3, 3) that turns the side `sign` of `axis` towards the camera."""
    forward = -sign * np.eye(3)[axis]  # away from the camera
    right = np.eye(3)[(axis + 1) % 3]
    return torch.tensor(np.stack([right, np.cross(forward, right), forward]))[None]


SIDES = [(axis, sign) for axis in range(3) for sign in (-1, 1)]


@pytest.mark.parametrize(("axis", "sign"), SIDES)
def test_colours_of_the_sides_of_a_box(axis, sign):
    mesh = meshes.colored_box((0.06, 0.06, 0.06))
    pose, intrinsics = meshes.view(mesh)
    pose = Pose(towards(axis, sign), pose.translation)
    albedo, normal, _, _ = arrays(RENDERER.render([mesh], pose, intrinsics))
    expected = meshes.FACE_COLORS[2 * axis + (sign > 0)]
    np.testing.assert_allclose(albedo[60:68, 60:68] * 255, [[expected] * 8] * 8, atol=0.6)
    np.testing.assert_allclose(normal[60:68, 60:68], [[(0, 0, -1)] * 8] * 8, atol=1e-6)


# Textures


@pytest.mark.parametrize("texels", [1, 8, 64])
def test_a_checkerboard_shows_its_colours_the_right_way_round(texels):
    texture, colors = checkerboard(8, texels)
    albedo, _, _, mask = draw(meshes.square(texture=texture), size=256)
    rows, columns = np.nonzero(mask)
    top, left, side = rows.min(), columns.min(), np.ptp(rows) + 1
    centre = ((np.arange(8) + 0.5) * side / 8).astype(int)
    seen = albedo[top + centre][:, left + centre] * 255
    np.testing.assert_allclose(seen, colors, atol=12 if texels == 1 else 2)


@pytest.mark.parametrize(("axis", "sign"), SIDES)
def test_a_box_shows_the_texture_unmirrored_on_every_side(axis, sign):
    corners = [(250, 0, 0), (0, 250, 0), (250, 250, 0), (0, 0, 250)]  # clockwise from top left
    texture = np.zeros((32, 32, 3), np.uint8)
    texture[:16, :16], texture[:16, 16:], texture[16:, 16:], texture[16:, :16] = corners
    mesh = meshes.textured_box(texture, (0.06, 0.06, 0.06))
    pose, intrinsics = meshes.view(mesh)
    pose = Pose(towards(axis, sign), pose.translation)
    albedo = arrays(RENDERER.render([mesh], pose, intrinsics))[0] * 255
    seen = [albedo[50, 50], albedo[50, 77], albedo[77, 77], albedo[77, 50]]
    labels = [int(np.abs(np.array(corners) - color).max(1).argmin()) for color in seen]
    assert [(label - labels[0]) % 4 for label in labels] == [0, 1, 2, 3]


# Batches, odd cameras, odd poses


def test_skewed_and_unequal_intrinsics():
    mesh = meshes.colored_box()
    pose, intrinsics = meshes.view(mesh, seed=5)
    intrinsics[0, 0, 1], intrinsics[0, 1, 1] = 90.0, 1.1 * intrinsics[0, 1, 1]
    mask = arrays(RENDERER.render([mesh], pose, intrinsics))[3]
    points = pose.transform(torch.from_numpy(mesh.vertices).double())[0] @ intrinsics[0].T
    hull = cv2.convexHull((points[:, :2] / points[:, 2:]).numpy().astype(np.float32))
    distance = inside_by(hull, 128)
    assert (mask[distance > 0.02] == 1).all() and (mask[distance < -0.02] == 0).all()


@pytest.mark.parametrize("place", [(0, 0, -0.7), (5.0, 0, 0.7), (0, -5.0, 0.7)])
def test_out_of_sight_is_empty(place):
    mesh = meshes.colored_box()
    pose, intrinsics = meshes.view(mesh)
    pose = Pose(pose.rotation, torch.tensor([place], dtype=torch.float64))
    buffer = RENDERER.render([mesh], pose, intrinsics)
    for value in (buffer.albedo, buffer.normal, buffer.depth, buffer.mask):
        assert (value == 0).all()


def test_from_inside_of_the_object_its_far_wall_is_seen():
    mesh = meshes.colored_box((0.1, 0.1, 0.1))
    pose = Pose(torch.eye(3)[None], torch.zeros(1, 3))
    intrinsics = torch.tensor([[[128.0, 0, 63.5], [0, 128, 63.5], [0, 0, 1]]])
    _, normal, depth, mask = arrays(RENDERER.render([mesh], pose, intrinsics))
    assert mask.all()
    np.testing.assert_allclose(depth[64, 64], 0.05, atol=1e-6)
    np.testing.assert_allclose(normal[64, 64], [0, 0, -1], atol=1e-6)


def test_partly_behind_the_camera_the_front_is_still_seen():
    mesh = meshes.colored_box((0.1, 0.1, 0.4))
    pose = Pose(torch.eye(3)[None], torch.tensor([[0.0, 0.1, 0.1]]))
    intrinsics = torch.tensor([[[64.0, 0, 63.5], [0, 64, 63.5], [0, 0, 1]]])
    mask = arrays(RENDERER.render([mesh], pose, intrinsics))[3]
    assert mask[127, 64] == 1 and mask[20, 64] == 0


def test_float32_and_gradients_are_accepted():
    mesh = meshes.colored_box()
    pose, intrinsics = meshes.view(mesh, seed=2)
    single = Pose(pose.rotation.float().requires_grad_(), pose.translation.float())
    buffer = RENDERER.render([mesh], single, intrinsics.float())
    assert not buffer.depth.requires_grad
    exact = RENDERER.render([mesh], pose, intrinsics)
    assert (buffer.mask != exact.mask).sum() <= 4


def test_a_missing_embreex_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "embreex.rtcore_scene", None)
    with pytest.raises(RenderingUnavailable, match="pip install embreex"):
        make_renderer("embree")
