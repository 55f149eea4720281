"""Shaded layers of a frame: objects rendered in their windows, put together by depth.

Never knows motion or files. Colours are linear light.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...rendering.renderer import Renderer
from ...typing import Float32
from ..imaging.linear_light import to_linear
from ..imaging.shading import Illumination, Material, ShadedSurface, shade
from .shadow_map import light_visibility

HEMISPHERE = 0.5  # how much darker the ambient light is from below


@dataclass(frozen=True)
class Layer:
    """Shaded pixels of one object, to be laid over a frame at (left, top)."""

    left: int
    top: int
    color: Float32  # (size, size, 3) linear light
    depth: Float32  # (size, size), 0 where there is nothing


@dataclass(frozen=True)
class SceneLight:
    """One key light from far away and light from all around, brighter from above."""

    towards: tuple[float, float, float]  # unit vector to the light, camera frame
    key: tuple[float, float, float]  # RGB
    ambient: tuple[float, float, float]  # RGB

    def illumination(self, batch: int) -> Illumination:
        """The same light in each of B views."""
        return Illumination(
            torch.tensor([*self.towards, 0.0]).expand(1, batch, 4),
            torch.ones(1, batch),
            torch.tensor(self.key).expand(batch, 3),
            torch.ones(batch),
            torch.tensor(self.ambient).expand(batch, 3),
            HEMISPHERE,
        )


@dataclass(frozen=True)
class SceneMaterial:
    """How an object of the scene reflects, as in `imaging.shading.Material`."""

    metallic: float = 0.0
    smoothness: float = 0.3

    def reflection(self, batch: int) -> Material:
        """The same material in each of B views."""
        return Material(torch.full((batch,), self.metallic), torch.full((batch,), self.smoothness))


def render_layers(
    renderer: Renderer,
    mesh: Mesh,
    poses: Pose,
    camera: Camera,
    offsets: NDArray[np.float64],
    light: SceneLight,
    material: SceneMaterial,
) -> list[Layer]:
    """The shaded object at each of the centred poses (B), each sampled `offsets` (B, 2) pixels off.

    Only the window around the object inside the frame is rendered; its pixels are exactly the
    frame's. Empty if the object is out of sight.
    """
    window = _window(mesh, poses, camera)
    if window is None:
        return []
    left, top, size = window
    count = len(poses)
    shift = torch.from_numpy(offsets) + torch.tensor([left, top], dtype=torch.float64)
    intrinsics = camera.matrix.expand(count, 3, 3).clone()
    intrinsics[:, :2, 2] -= shift
    gbuffer = renderer.render([mesh] * count, poses, intrinsics, size)
    surface = ShadedSurface.of(
        gbuffer.albedo, gbuffer.normal, gbuffer.depth, gbuffer.mask, intrinsics.float(),
        poses.translation.float(),
    )  # fmt: skip
    surface = replace(surface, albedo=to_linear(surface.albedo))
    towards, middle = torch.tensor(light.towards), poses[count // 2]
    visibility = light_visibility(renderer, mesh, middle, towards, surface)
    shaded = shade(surface, light.illumination(count), material.reflection(count), visibility)
    color = surface.image(shaded).permute(0, 2, 3, 1).numpy()
    depth = gbuffer.depth[:, 0].numpy()
    return [Layer(left, top, color[b], depth[b]) for b in range(count)]


def composite(frame: Float32, depth: Float32, layer: Layer) -> None:
    """Put a layer over a frame where it is nearer than `depth` (H, W), which is kept up to date."""
    height, width = depth.shape
    size = len(layer.depth)
    x0, y0 = max(layer.left, 0), max(layer.top, 0)
    x1, y1 = min(layer.left + size, width), min(layer.top + size, height)
    if x0 >= x1 or y0 >= y1:
        return
    inside = np.s_[y0 - layer.top : y1 - layer.top, x0 - layer.left : x1 - layer.left]
    there = layer.depth[inside]
    here = depth[y0:y1, x0:x1]
    nearer = (there > 0) & (there < here)
    here[nearer] = there[nearer]
    frame[y0:y1, x0:x1][nearer] = layer.color[inside][nearer]


def silhouette(
    renderer: Renderer, mesh: Mesh, pose: Pose, camera: Camera, window: tuple[int, int, int]
) -> Float32:
    """Depth (size, size) of a centred pose, seen through the window (left, top, size)."""
    left, top, size = window
    intrinsics = camera.crop(left, top, size, size).matrix[None]
    batch = Pose(pose.rotation[None], pose.translation[None])
    return np.asarray(renderer.render([mesh], batch, intrinsics, size).depth[0, 0].numpy())


def bounds(mesh: Mesh, poses: Pose, camera: Camera) -> tuple[float, float, float, float] | None:
    """Left, top, right, bottom pixel of an object over all poses (B); None if it comes too near."""
    vertices = torch.from_numpy(mesh.vertices).to(torch.float64)
    points = poses.transform(vertices.expand(len(poses), -1, 3))
    if float(points[..., 2].min()) < 0.02 * mesh.sphere_diameter:
        return None
    pixels = camera.project(points).reshape(-1, 2)
    (left, top), (right, bottom) = pixels.amin(0).tolist(), pixels.amax(0).tolist()
    return left, top, right, bottom


def _window(mesh: Mesh, poses: Pose, camera: Camera) -> tuple[int, int, int] | None:
    """Left, top and size of a square that holds all of the object that the frame sees."""
    box = bounds(mesh, poses, camera) or (0, 0, camera.width, camera.height)
    left, top = max(int(box[0]) - 3, 0), max(int(box[1]) - 3, 0)
    right, bottom = min(int(box[2]) + 4, camera.width), min(int(box[3]) + 4, camera.height)
    if right <= left or bottom <= top:
        return None
    return left, top, max(right - left, bottom - top)
