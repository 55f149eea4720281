"""Single images with known truth: one object at a random pose before a photo, and a start pose.

Never refines. Lights are those of training pairs; a photo card hides a third of the object where
occlusion is asked for.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from kornia.geometry.transform import warp_perspective
from torch import Tensor

from ..actions import PoseAction
from ..errors import InputError
from ..estimation import Target
from ..geometry.crop import PADDING, View, crop_homography, look_at
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.rotation import random_rotations
from ..rendering.renderer import Renderer
from .augmentation.lights import LightConfig, random_lighting
from .augmentation.random_source import RandomSource
from .default_camera import CAMERA
from .imaging.blur import gaussian_blur
from .imaging.layers import over, premultiplied
from .imaging.linear_light import GAMMA, to_display, to_linear
from .imaging.sensor import add_noise, to_bytes
from .training.clusters import ClusterConfig, draw_delta

FINE = 320  # pixels of the crop in which the object is rendered before it is warped in
NOISE = 0.01  # of full white


@dataclass(frozen=True)
class Case:
    """A picture with a start pose, and the true pose; both in the mesh file's frame."""

    target: Target
    truth: Pose


def make_cases(
    meshes: Sequence[Mesh],
    photos: Sequence[np.ndarray],
    renderer: Renderer,
    *,
    cluster: str,
    occluded: float,
    number: int,
    seed: int = 0,
    gamma: float = GAMMA,
) -> Iterator[Case]:
    """`number` cases, the objects in turn; `occluded` is the share of cases with an occluder.

    At the object's edge light mixes by `gamma`, as in a camera; at 1 colours mix, as in many
    renderers.
    """
    if not gamma > 0:
        raise InputError(f"gamma is {gamma}, must be above 0: 2.2 as in a camera, 1 without.")
    random = np.random.default_rng(seed)
    generator = torch.Generator().manual_seed(seed)
    for k in range(number):
        mesh = meshes[k % len(meshes)]
        truth = _random_pose(mesh, random, generator)
        diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
        delta = torch.from_numpy(draw_delta(random, ClusterConfig(), cluster))
        start = PoseAction.from_delta(delta).apply_centred(truth, diameter)
        photo = photos[int(random.integers(len(photos)))]
        picture = _photo(photo)
        picture = _put(picture, mesh, truth, renderer, generator, gamma)
        if random.random() < occluded:
            card_photo = photos[int(random.integers(len(photos)))]
            picture = _occlude(picture, card_photo, mesh, truth, random)
        picture = picture * random.uniform(0.8, 1.2)
        picture = add_noise(picture, torch.randn(picture.shape, generator=generator), NOISE)
        yield Case(
            Target(to_bytes(picture).permute(1, 2, 0), CAMERA, mesh, mesh.outer(start)),
            mesh.outer(truth),
        )


def _random_pose(mesh: Mesh, random: np.random.Generator, generator: torch.Generator) -> Pose:
    """A centred pose with the whole object in the picture, 2.5 to 7 diameters away."""
    depth = random.uniform(2.5, 7.0) * mesh.sphere_diameter
    reach = 0.5 * mesh.sphere_diameter * CAMERA.fx / depth
    u = random.uniform(reach, CAMERA.width - 1 - reach)
    v = random.uniform(min(reach, 239), max(CAMERA.height - 1 - reach, 240))
    ray = [(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, 1.0]
    place = torch.tensor(ray, dtype=torch.float64) * depth
    return Pose(random_rotations(1, generator)[0], place)


def _photo(photo: np.ndarray) -> Tensor:
    tensor = torch.tensor(photo).permute(2, 0, 1)[None].float() / 255
    size = (CAMERA.height, CAMERA.width)
    return torch.nn.functional.interpolate(tensor, size, mode="bilinear", align_corners=False)[0]


def _put(
    picture: Tensor,
    mesh: Mesh,
    truth: Pose,
    renderer: Renderer,
    generator: torch.Generator,
    gamma: float,
) -> Tensor:
    """The picture with the shaded object, rendered in a fine look-at view and warped in."""
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    view = look_at(truth, diameter)
    matrix = view.intrinsics.clone()
    matrix[0, 0] = matrix[1, 1] = FINE / PADDING * view.distance / diameter
    matrix[:2, 2] = (FINE - 1) / 2
    fine = View(view.rotation, matrix, view.distance)
    virtual = fine.to_virtual(truth)
    pose = Pose(virtual.rotation[None], virtual.translation[None])
    buffer = renderer.render([mesh], pose, matrix[None], FINE)
    distance = (view.distance / diameter).float()[None]
    depth = (buffer.depth / diameter.float() - distance[0]) * buffer.mask
    lit = random_lighting(
        buffer.albedo,
        buffer.normal,
        depth,
        buffer.mask,
        distance,
        LightConfig(),
        RandomSource(generator),
    )
    layer = premultiplied(to_linear(lit, gamma), buffer.mask)
    scale = float(matrix[0, 0]) / CAMERA.fx
    if scale > 1:  # the picture is coarser: blur first, or edges alias
        layer = gaussian_blur(layer, torch.tensor([0.45 * scale]), int(2 * scale))
    back = torch.linalg.inv(crop_homography(fine, CAMERA.matrix))[None].float()
    warped: Tensor = warp_perspective(
        layer, back, (CAMERA.height, CAMERA.width), align_corners=True
    )
    return to_display(over(to_linear(picture[None], gamma), warped), gamma)[0]


def _occlude(
    picture: Tensor, photo: np.ndarray, mesh: Mesh, truth: Pose, random: np.random.Generator
) -> Tensor:
    """A photo card over about a third of the object."""
    u, v = CAMERA.project(truth.translation).tolist()
    side = CAMERA.fx * mesh.sphere_diameter / float(truth.translation[2])
    size = max(6, int(0.62 * side))
    angle = random.uniform(0, 2 * np.pi)
    x = int(u + 0.35 * side * np.cos(angle) - size / 2)
    y = int(v + 0.35 * side * np.sin(angle) - size / 2)
    card = _photo(photo)
    x0, y0 = max(x, 0), max(y, 0)
    x1, y1 = min(x + size, CAMERA.width), min(y + size, CAMERA.height)
    occluded = picture.clone()
    if x1 > x0 and y1 > y0:
        occluded[:, y0:y1, x0:x1] = card[:, y0:y1, x0:x1]
    return occluded
