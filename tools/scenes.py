"""Pictures that the fitting tools look at: what is in them, and how wrong a pose is there.

Synthetic ones of meshes: among seven others on a table, small in a photograph, or alone, moving,
partly covered. Meshes and pictures can be spoilt, as scans and cameras do.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from moveit6d import Camera, Mesh, Pose
from moveit6d.evaluation.metrics import add_s
from moveit6d.geometry.mesh import Unit
from moveit6d.synthesis.objects.reshape import reshaped
from moveit6d.synthesis.sequences.sequence import Scene

FRAMES = 44  # of a scene, of which one is looked at
SIZES = (0.13, 0.28)  # metres, of objects on a table
OTHERS = 7  # beside an object on a table
FLATTEST = 0.2  # of the diameter: what is flatter does not stand on a table
SEEN = 0.1  # share of an object that must be visible
NOISE = (1.0, 5.0)  # grey levels
BLUR = (0.3, 1.0)  # pixels


@dataclass(frozen=True)
class Target:
    """An object in a picture: its mesh as the network has it, and its true pose."""

    mesh: Mesh
    truth: Pose


def table(
    rng: np.random.Generator, paths: Sequence[Path], photos: Sequence[NDArray[np.uint8]],
    unit: Unit = "m",
) -> tuple[NDArray[np.uint8], Camera, list[Target]]:  # fmt: skip
    """Objects around another one, small in a photograph."""
    meshes: list[Mesh] = []
    for path in paths:
        mesh = Mesh.load(path, unit=unit, allow_flat=True)
        if sorted(np.ptp(mesh.vertices, 0))[1] / mesh.diameter > FLATTEST:
            meshes.append(of_size(mesh, rng.uniform(*SIZES)))
        if len(meshes) == OTHERS + 1:
            break
    scene = Scene(meshes[0], int(rng.integers(1 << 31)), FRAMES, "easy", photos, others=meshes[1:])
    seen = scene.render_frame(FRAMES // 2)
    photo = photos[int(rng.integers(len(photos)))]
    image, camera = within_photo(rng, seen.image, scene.camera, photo)
    every = [(meshes[0], seen.pose, seen.visible_fraction)]
    others = zip(scene.others, seen.others, strict=True)
    every += [(one.mesh, pose, share) for one, (pose, share) in others]
    targets = [Target(mesh, pose) for mesh, pose, share in every if share >= SEEN]
    return image, camera, [one for one in targets if _is_inside(one, camera)]


def moving(
    rng: np.random.Generator, mesh: Mesh, photos: Sequence[NDArray[np.uint8]]
) -> tuple[NDArray[np.uint8], Camera, list[Target]]:
    """One object in a frame of a clip."""
    level = str(rng.choice(["occ", "fast", "hard", "hard"]))
    scene = Scene(mesh, int(rng.integers(1 << 31)), FRAMES, level, photos)
    seen = scene.render_frame(int(rng.integers(FRAMES)))
    return seen.image, scene.camera, [Target(mesh, seen.pose)]


def within_photo(
    rng: np.random.Generator, image: NDArray[np.uint8], camera: Camera, photo: NDArray[np.uint8]
) -> tuple[NDArray[np.uint8], Camera]:
    """The picture, smaller, somewhere in a photograph of its size; its camera there."""
    height, width = image.shape[:2]
    factor = rng.uniform(0.45, 0.9)
    inner = round(width * factor), round(height * factor)
    left, top = (int(rng.integers(0, b - a)) for a, b in zip(inner, (width, height), strict=True))
    whole = cv2.resize(photo, (width, height), interpolation=cv2.INTER_AREA)
    small = cv2.resize(image, inner, interpolation=cv2.INTER_AREA)
    whole[top : top + inner[1], left : left + inner[0]] = small
    x, y = inner[0] / width, inner[1] / height
    middle = (camera.cx + 0.5) * x - 0.5 + left, (camera.cy + 0.5) * y - 0.5 + top
    return whole.astype(np.uint8), Camera(camera.fx * x, camera.fy * y, *middle, width, height)


def _is_inside(target: Target, camera: Camera) -> bool:
    """Whether the middle of the object is in the picture."""
    u, v = camera.project(target.mesh.inner(target.truth).translation.double()).tolist()
    return bool(0 <= u < camera.width and 0 <= v < camera.height)


def spoilt(rng: np.random.Generator, mesh: Mesh) -> Mesh:
    """The mesh with blurred colours of less contrast and of another light."""
    contrast, tint = rng.uniform(0.45, 0.85), 1 + rng.uniform(-0.25, 0.25, 3)

    def dull(colours: NDArray[np.uint8]) -> NDArray[np.uint8]:
        values = colours[..., :3].astype(np.float64)
        mean = values.reshape(-1, 3).mean(0)
        dulled: NDArray[np.uint8] = np.clip(
            ((values - mean) * contrast + mean) * tint, 0, 255
        ).astype(np.uint8)
        return dulled

    texture, vertices = mesh.texture, mesh.vertex_colors
    if texture is not None:
        sigma = max(texture.shape) / rng.uniform(90, 400)
        return Mesh.from_arrays(
            mesh.name, mesh.vertices, mesh.faces, uv=mesh.uv,
            texture=dull(cv2.GaussianBlur(texture, (0, 0), sigma).astype(np.uint8)),
        )  # fmt: skip
    if vertices is not None:
        return Mesh.from_arrays(mesh.name, mesh.vertices, mesh.faces, vertex_colors=dull(vertices))
    return mesh


def spoilt_picture(rng: np.random.Generator, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """The picture, blurred a little, with noise."""
    soft = cv2.GaussianBlur(image, (0, 0), rng.uniform(*BLUR))
    noise = rng.normal(0, rng.uniform(*NOISE), image.shape)
    spoilt: NDArray[np.uint8] = np.clip(soft + noise, 0, 255).astype(np.uint8)
    return spoilt


def of_size(mesh: Mesh, diameter: float) -> Mesh:
    """The mesh, scaled to a diameter."""
    return reshaped(mesh, mesh.vertices * (diameter / mesh.diameter))


def relative_error(mesh: Mesh, found: Pose, true: Pose) -> float:
    """ADD in diameters."""
    points = torch.from_numpy(mesh.sample_points(500))
    return float(add_s(found, true, points, False)) / mesh.diameter
