"""A mesh painted from one picture: the side that a camera sees takes the picture's colours.

Never moves a surface and never renders: what is hidden is told by points on the surface.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch
from numpy.typing import NDArray

from ..config import TextureConfig
from ..errors import InputError
from ..typing import ImageLike
from .camera import Camera
from .images import rgb_bytes
from .inputs import camera_of, pose_of
from .pose import Pose

if TYPE_CHECKING:
    from .mesh import Mesh

# Layout of the texture: neither decides a colour.
MARGIN = 2  # pixels beside the object that it keeps
STRIP = 8  # pixels of its rows for what is not seen
# What a surface seen edge-on still shows, of 1 seen face-on, under the renderings' light at the
# camera (`rendering.shading`); the networks are trained with it.
AMBIENT = 0.45
DEFAULT = TextureConfig()


def paint(
    mesh: Mesh,
    image: ImageLike,
    pose: Pose,
    camera: Camera,
    config: TextureConfig = DEFAULT,
) -> Mesh:
    """A copy of a mesh with the colours that an image (H, W, 3) shows at a pose.

    `pose` is the mesh file's frame; the image is seen through the camera's lens, if it has one.
    Sides that are not seen take the mean colour. `InputError` for what is no image of the camera
    (`images`) and no pose (`inputs`), and if too little of the object is seen.
    """
    from .mesh import Mesh

    picture, pose = rgb_bytes(image, camera_of(camera)), pose_of(pose, "The pose")
    vertices, faces = _divided(mesh, config)
    centred = mesh.inner(pose.to(torch.float64))
    rotation, shift = centred.rotation.numpy(), centred.translation.numpy()
    placed = vertices @ rotation.T + shift
    pixels = camera.project(torch.from_numpy(placed)).numpy()
    corners = placed[faces]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True) + 1e-12
    middles = corners.mean(1)
    rays = middles / (np.linalg.norm(middles, axis=1, keepdims=True) + 1e-12)
    facing = np.abs((normals * rays).sum(1))  # single sheets are seen from both sides
    seen = (facing > config.min_facing) & _in_image(pixels[faces], camera)
    steep, tolerance = np.maximum(facing, config.min_facing), config.hidden * mesh.sphere_diameter
    # What is behind the camera, or farther aside than its lens shows, has pixels too.
    seen &= _shown(placed, camera)[faces].all(1)
    seen &= ~_hidden(corners, middles, steep, camera, tolerance)
    if seen.sum() < 4:
        raise InputError(
            f"{mesh.name}: the camera sees too little of it at this pose to take its colours; "
            "check the pose and the camera."
        )
    return _textured(Mesh, mesh, picture, vertices, faces, pixels, seen, facing)


def _divided(mesh: Mesh, config: TextureConfig) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Vertices and faces with triangles small enough to be painted one by one."""
    from trimesh.remesh import subdivide

    vertices, faces = mesh.vertices.astype(np.float64), mesh.faces.astype(np.int64)
    longest = mesh.sphere_diameter / config.pieces
    while True:
        corners = vertices[faces]
        edges = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(1)
        long = np.flatnonzero(edges > longest)
        if not len(long) or len(faces) + 3 * len(long) > config.max_faces:
            return vertices, faces
        vertices, faces = subdivide(vertices, faces, face_index=long)


def _in_image(pixels: NDArray[np.float64], camera: Camera) -> NDArray[np.bool_]:
    """Which triangles (F, 3, 2) lie in the image."""
    low, high = pixels.min((1,)), pixels.max((1,))
    inside = (low >= 0).all(1) & (high[:, 0] <= camera.width - 1)
    found: NDArray[np.bool_] = inside & (high[:, 1] <= camera.height - 1)
    return found


def _shown(points: NDArray[np.float64], camera: Camera) -> NDArray[np.bool_]:
    """Which of the points (N, 3) the camera can see, in the image or beside it."""
    shown: NDArray[np.bool_] = points[:, 2] > 0
    return shown if camera.lens is None else camera.lens.shows(points)


def _hidden(
    corners: NDArray[np.float64],
    middles: NDArray[np.float64],
    facing: NDArray[np.float64],
    camera: Camera,
    tolerance: float,
) -> NDArray[np.bool_]:
    """Which faces lie behind others: a depth map of points all over the faces (F, 3, 3).

    `facing` (F,) are cosines to the viewing rays, above 0.
    """
    weights = np.array([
        [1 / 3, 1 / 3, 1 / 3], [0.6, 0.2, 0.2], [0.2, 0.6, 0.2], [0.2, 0.2, 0.6],
        [0.45, 0.45, 0.1], [0.45, 0.1, 0.45], [0.1, 0.45, 0.45],
    ])  # fmt: skip
    points = np.einsum("wk,fkx->fwx", weights, corners).reshape(-1, 3)
    points = points[_shown(points, camera)]  # others would hide what their pixels show
    spacing = float(np.linalg.norm(corners[:, 1] - corners[:, 0], axis=1).max()) / 3
    cell = max(1.0, camera.fx * spacing / max(float(middles[:, 2].min()), 1e-6))

    rows, columns = int(camera.height / cell) + 3, int(camera.width / cell) + 3

    def cells(places: NDArray[np.float64]) -> NDArray[np.int64]:
        pixels = camera.project(torch.from_numpy(places)).numpy() / cell
        column = np.clip(pixels[:, 0], -1, camera.width / cell).astype(np.int64) + 1
        row = np.clip(pixels[:, 1], -1, camera.height / cell).astype(np.int64) + 1
        found: NDArray[np.int64] = row * columns + column
        return found

    nearest = np.full(rows * columns, np.inf)
    np.minimum.at(nearest, cells(points), points[:, 2])
    # A cell of a slanted face spans some depth itself.
    slack = tolerance + 1.5 * spacing / facing
    hidden: NDArray[np.bool_] = middles[:, 2] > nearest[cells(middles)] + slack
    return hidden


def _textured(
    kind: type[Mesh],
    mesh: Mesh,
    image: NDArray[np.uint8],
    vertices: NDArray[np.float64],
    faces: NDArray[np.int64],
    pixels: NDArray[np.float64],
    seen: NDArray[np.bool_],
    facing: NDArray[np.float64],
) -> Mesh:
    """The mesh with a part of the image as its texture and a strip of its mean colour below."""
    used = pixels[np.unique(faces[seen])]
    left, top = np.maximum(np.floor(used.min(0)).astype(int) - MARGIN, 0)
    right, bottom = np.ceil(used.max(0)).astype(int) + MARGIN + 1
    part = image[top:bottom, left:right].astype(np.float32)
    middle = pixels[faces[seen]].mean(1).round().astype(int)
    shade = AMBIENT + (1 - AMBIENT) * facing[seen]
    # The lamp of the renderings shines along the viewing ray: what it will darken is made brighter.
    light = np.zeros(part.shape[:2], np.float32)
    light[middle[:, 1] - top, middle[:, 0] - left] = 1 / shade
    part *= _spread(light)[..., None]
    mean = np.median(part[middle[:, 1] - top, middle[:, 0] - left], axis=0)
    strip = np.broadcast_to(mean, (STRIP, part.shape[1], 3))
    texture = np.concatenate([part, strip]).round().clip(0, 255).astype(np.uint8)
    height, width = texture.shape[:2]
    uv = np.column_stack([
        (pixels[:, 0] - left + 0.5) / width, 1 - (pixels[:, 1] - top + 0.5) / height
    ])  # fmt: skip
    plain = np.full_like(uv, (0.5, 0.5 * STRIP / height))
    return kind.from_arrays(
        mesh.name,
        np.concatenate([vertices, vertices]) + mesh.center,
        np.concatenate([faces[seen], faces[~seen] + len(vertices)]),
        uv=np.concatenate([uv, plain]).clip(0, 1),
        texture=texture,
        symmetries=mesh.symmetries,
    )


def _spread(values: NDArray[np.float32]) -> NDArray[np.float32]:
    """Values (H, W) that are known where they are not 0, spread smoothly over all pixels."""
    import cv2

    known = (values > 0).astype(np.float32)
    total, weight = np.zeros_like(values), np.full_like(values, 1e-6)
    for sigma, share in ((2.0, 1.0), (6.0, 1e-2), (20.0, 1e-4)):
        total += share * cv2.GaussianBlur(values, (0, 0), sigma)
        weight += share * cv2.GaussianBlur(known, (0, 0), sigma)
    spread: NDArray[np.float32] = total / weight
    return np.where(weight > 2e-6, spread, 1.0).astype(np.float32)
