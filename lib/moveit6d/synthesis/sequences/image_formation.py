"""From G-buffers to a photograph: light on surfaces, layers over a ground, exposure, noise.

Never knows motion or files. Colours between here and `expose` are linear light.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...rendering.renderer import GBuffer, Renderer

LinearImage = NDArray[np.float32]  # (H, W, 3) linear light
GAMMA = 2.2


@dataclass(frozen=True)
class Light:
    """One key light from far away and light from all around, brighter from above."""

    towards: tuple[float, float, float]  # unit vector to the light, camera frame
    key: tuple[float, float, float]  # RGB
    ambient: tuple[float, float, float]  # RGB


@dataclass(frozen=True)
class Material:
    """How a surface shines: strength and sharpness of its highlight."""

    gloss: float = 0.1
    power: float = 20.0


@dataclass(frozen=True)
class Layer:
    """Lit pixels of one object, to be laid over a frame at (left, top); arrays (size, size, …)."""

    left: int
    top: int
    color: LinearImage
    depth: NDArray[np.float32]  # (size, size), 0 where there is nothing


@dataclass(frozen=True)
class Sensor:
    """What the camera adds: sharpness of the lens, brightness and noise."""

    blur: float  # pixels, standard deviation
    exposure: float
    read_noise: float  # of full white
    shot_noise: float  # of full white, at full white


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep torch to one thread: with tensors this small, several only wait for each other."""
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    try:
        yield
    finally:
        torch.set_num_threads(before)


def render_layers(
    renderer: Renderer,
    mesh: Mesh,
    poses: Pose,
    camera: Camera,
    offsets: NDArray[np.float64],
    light: Light,
    material: Material,
) -> list[Layer]:
    """The lit object at each of the centred poses (B), each sampled `offsets` (B, 2) pixels off.

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
    shadow = _shadow(renderer, mesh, poses[count // 2], light, gbuffer, intrinsics, poses)
    color = shade(gbuffer, light, material, shadow).permute(0, 2, 3, 1).numpy()
    depth = gbuffer.depth[:, 0].numpy()
    return [Layer(left, top, color[b], depth[b]) for b in range(count)]


def shade(gbuffer: GBuffer, light: Light, material: Material, lit: Tensor | float = 1.0) -> Tensor:
    """Linear light (B, 3, H, W) of a G-buffer; `lit` (B, 1, H, W): where the key light falls."""
    towards = torch.tensor(light.towards)[None, :, None, None]
    to_eye = torch.tensor([0.0, 0.0, -1.0]).view(1, 3, 1, 1)
    halfway = torch.nn.functional.normalize(towards + to_eye, dim=1)
    normal = gbuffer.normal
    facing = (normal * towards).sum(1, keepdim=True).clamp_min(0) * lit
    sky = 0.75 - 0.25 * normal[:, 1:2]  # y points down
    key, ambient = (torch.tensor(c).view(1, 3, 1, 1) for c in (light.key, light.ambient))
    shine = (normal * halfway).sum(1, keepdim=True).clamp_min(0) ** material.power * lit
    color = gbuffer.albedo**GAMMA * (ambient * sky + key * facing)
    return (color + material.gloss * key * shine) * gbuffer.mask


def composite(frame: LinearImage, depth: NDArray[np.float32], layer: Layer) -> None:
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


def expose(rng: np.random.Generator, frame: LinearImage, sensor: Sensor) -> NDArray[np.uint8]:
    """The picture (H, W, 3) uint8 that a camera makes of linear light."""
    import cv2

    sharp = cv2.GaussianBlur(frame, (0, 0), sensor.blur) * sensor.exposure
    variance = sensor.read_noise**2 + sensor.shot_noise**2 * np.clip(sharp, 0, 1)
    noisy = sharp + np.sqrt(variance) * rng.standard_normal(frame.shape, np.float32)
    levels = np.rint(255 * np.linspace(0, 1, 4096) ** (1 / GAMMA)).astype(np.uint8)
    return np.asarray(levels[(noisy.clip(0, 1) * 4095 + 0.5).astype(np.int16)])


def linear(picture: NDArray[np.uint8]) -> LinearImage:
    """A picture (H, W, 3) as linear light."""
    table = np.asarray((np.arange(256) / 255) ** GAMMA, np.float32)
    return table[picture]


def silhouette(
    renderer: Renderer, mesh: Mesh, pose: Pose, camera: Camera, window: tuple[int, int, int]
) -> NDArray[np.float32]:
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


def _shadow(
    renderer: Renderer,
    mesh: Mesh,
    pose: Pose,
    light: Light,
    gbuffer: GBuffer,
    intrinsics: Tensor,
    poses: Pose,
    size: int = 160,
) -> Tensor:
    """Where the key light reaches the object past itself: (B, 1, H, W) in [0, 1].

    A shadow map: the depth seen from the light at the middle pose, compared with each pixel's.
    """
    far = 6 * mesh.sphere_diameter
    forward = -torch.tensor(light.towards, dtype=torch.float64)
    side = torch.linalg.cross(forward, torch.eye(3, dtype=torch.float64)[forward.abs().argmin()])
    side = side / side.norm()
    turn = torch.stack([side, torch.linalg.cross(forward, side), forward])  # camera → light
    focal = size / 1.1 * far / mesh.sphere_diameter
    middle = (size - 1) / 2
    view = torch.tensor([[focal, 0, middle], [0, focal, middle], [0, 0, 1]], dtype=torch.float64)
    place = torch.tensor([[0, 0, far]], dtype=torch.float64)
    seen = renderer.render([mesh], Pose((turn @ pose.rotation)[None], place), view[None], size)
    nearest = torch.where(seen.depth > 0, seen.depth, torch.full_like(seen.depth, 1e9))
    batch, _, rows, columns = gbuffer.depth.shape
    sample, row, column = gbuffer.mask[:, 0].nonzero(as_tuple=True)
    matrices = intrinsics.float()[sample]
    z = gbuffer.depth[sample, 0, row, column]
    x = (column - matrices[:, 0, 2]) / matrices[:, 0, 0] * z
    y = (row - matrices[:, 1, 2]) / matrices[:, 1, 1] * z
    offset = torch.stack([x, y, z], -1) - poses.translation.float()[sample]
    seen_from = offset @ turn.float().T + place.float()
    pixel = seen_from[:, :2] / seen_from[:, 2:] * focal + middle
    grid = (pixel * 2 + 1) / size - 1  # half-pixel rule
    bias = 0.02 * mesh.sphere_diameter
    lit = torch.zeros(len(sample))
    for dx, dy in ((-0.7, -0.3), (0.3, -0.7), (0.7, 0.3), (-0.3, 0.7)):  # soft edges
        moved = (grid + torch.tensor([dx, dy]) * 2 / size)[None, None]
        depth = torch.nn.functional.grid_sample(nearest, moved, "nearest", align_corners=False)
        lit += (seen_from[:, 2] < depth[0, 0, 0] + bias).float() / 4
    result = torch.ones(batch, 1, rows, columns)
    result[sample, 0, row, column] = lit
    return result
