"""Pictures of a mesh as a lens draws them, by the rays of their pixels; used by the tests only."""

from __future__ import annotations

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering import make_renderer

BEYOND = 60.0  # pixels beside the object that are rendered, too


def lens_picture(mesh: Mesh, pose: Pose, camera: Camera) -> NDArray[np.uint8]:
    """The mesh at a centred pose (H, W, 3) before grey noise; it lies within 75 degrees."""
    assert camera.lens is not None
    height, width = camera.height, camera.width
    centre = camera.pinhole.project(pose.translation).round()
    size = int(4 * camera.fx * mesh.sphere_diameter / float(pose.translation[2]) + BEYOND)
    corner = (centre - size // 2).numpy()
    intrinsics = camera.pinhole.crop(*corner.astype(int), size, size).matrix
    one = Pose(pose.rotation[None], pose.translation[None])
    buffer = make_renderer().render([mesh], one, intrinsics[None], size)
    drawn = torch.cat([buffer.albedo, buffer.mask], 1)[0].permute(1, 2, 0).float().numpy()
    y, x = np.mgrid[:height, :width]
    pixels = np.stack([x, y], -1).reshape(-1, 2).astype(np.float64)
    rays = camera.lens.directions(pixels, camera.matrix.numpy())
    plane = rays[:, :2] / np.maximum(rays[:, 2:], np.cos(np.radians(75)))
    place = plane * [camera.fx, camera.fy] + [camera.cx, camera.cy] - corner
    u, v = place.reshape(height, width, 2).astype(np.float32).transpose(2, 0, 1)
    seen = cv2.remap(drawn, u, v, cv2.INTER_LINEAR)
    noise = np.random.default_rng(0).integers(60, 120, (height, width, 3))
    mixed = noise * (1 - seen[..., 3:]) + 255 * seen[..., :3]
    return np.asarray(mixed.round().clip(0, 255), np.uint8)
