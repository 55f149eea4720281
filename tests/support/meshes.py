"""Small meshes with known answers, and cameras that look at them; used by the tests only."""

from __future__ import annotations

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose

FACE_COLORS = np.array(
    [[220, 30, 30], [30, 200, 40], [40, 60, 220], [230, 200, 20], [30, 200, 210], [200, 40, 210]],
    np.uint8,
)


def box_arrays(extents=(0.1, 0.06, 0.04)):
    """A box of six separate sides: vertices (24, 3), faces (12, 3), uv (24, 2), colours (24, 3).

    Sides in the order −x, +x, −y, +y, −z, +z; outward winding; each side shows the whole texture.
    """
    vertices, faces, uv = [], [], []
    for axis in range(3):
        for sign in (-1, 1):
            first, second = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
            if sign < 0:
                first, second = second, first
            start = len(vertices)
            for a, b in ((-1, -1), (1, -1), (1, 1), (-1, 1)):
                vertices.append(sign * np.eye(3)[axis] + a * first + b * second)
                uv.append(((a + 1) / 2, (b + 1) / 2))
            faces += [(start, start + 1, start + 2), (start, start + 2, start + 3)]
    half = np.array(extents) / 2
    return np.array(vertices) * half, np.array(faces), np.array(uv), FACE_COLORS.repeat(4, axis=0)


def colored_box(extents=(0.1, 0.06, 0.04), offset=(0, 0, 0)) -> Mesh:
    """A box with one colour a side, its centre at `offset` in the file's frame."""
    vertices, faces, _, colors = box_arrays(extents)
    return Mesh.from_arrays("box", vertices + np.array(offset), faces, vertex_colors=colors)


def textured_box(texture, extents=(0.1, 0.06, 0.04)) -> Mesh:
    """A box that shows the whole texture on each side."""
    vertices, faces, uv, _ = box_arrays(extents)
    return Mesh.from_arrays("textured box", vertices, faces, uv=uv, texture=texture)


def sphere(radius=0.05, subdivisions=5) -> Mesh:
    """A fine sphere (20,480 faces at 5 subdivisions), plain."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return Mesh.from_arrays("sphere", ball.vertices, ball.faces)


def l_shape() -> Mesh:
    """Two boxes that touch: not convex, without any symmetry."""
    first, faces, _, colors = box_arrays((0.1, 0.03, 0.02))
    second = box_arrays((0.03, 0.06, 0.04))[0] + (0.035, 0.045, 0.01)
    return Mesh.from_arrays(
        "L",
        np.concatenate([first, second]),
        np.concatenate([faces, faces + len(first)]),
        vertex_colors=np.concatenate([colors, colors[::-1]]),
    )


def square(side=0.1, texture=None, colors=None) -> Mesh:
    """A sheet in the plane z = 0, seen from −z with x right and y down; v = 1 is its top edge."""
    half = side / 2
    vertices = np.array([[-half, -half, 0], [half, -half, 0], [half, half, 0], [-half, half, 0]])
    faces = np.array([[0, 2, 1], [0, 3, 2]])
    uv = None if texture is None else np.array([[0, 1], [1, 1], [1, 0], [0, 0]])
    return Mesh.from_arrays("square", vertices, faces, uv=uv, texture=texture, vertex_colors=colors)


def rotation(seed: int) -> np.ndarray:
    """A random rotation (3, 3)."""
    return Rotation.random(random_state=np.random.RandomState(seed)).as_matrix()


def view(mesh: Mesh, seed: int | None = None, distance=0.7, size=128, offset=(0.0, 0.0)):
    """A pose (batch of 1) and intrinsics (1, 3, 3) at which the mesh fills the usual 1/1.4."""
    turn = np.eye(3) if seed is None else rotation(seed)
    focal, centre = size / 1.4 * distance / mesh.sphere_diameter, (size - 1) / 2
    matrix = [[focal, 0, centre], [0, focal, centre], [0, 0, 1]]
    pose = Pose(torch.tensor(turn)[None], torch.tensor([[*offset, distance]], dtype=torch.float64))
    return pose, torch.tensor([matrix], dtype=torch.float64)
