"""Closed loops on rendered objects: known starts, known truth, any cluster, covered or not.

Never trains. One object a picture: lit at a random pose before a photo, a third of it covered if
asked for, with a start pose some counts away.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from kornia.geometry.transform import warp_perspective
from torch import Tensor

from ..actions import PoseAction
from ..config import ContourConfig, MultiStartConfig, TrackerConfig
from ..estimation import Target, TrackingResult, refine_single
from ..geometry.crop import PADDING, View, crop_homography, look_at
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..geometry.rotation import random_rotations
from ..policies import Policy
from ..rendering.renderer import Renderer
from ..synthesis.augmentation.lighting import LightConfig, light
from ..synthesis.training.clusters import ClusterConfig, draw_delta
from .default_camera import CAMERA
from .metrics import add

LOOP_ONLY = TrackerConfig(
    multi_start=MultiStartConfig(enabled=False), contour=ContourConfig(enabled=False)
)
FINE = 320  # pixels of the patch in which the object is rendered before it is put in the picture


@dataclass(frozen=True)
class Case:
    """A picture with a start pose, and the true pose; both in the mesh file's frame."""

    target: Target
    truth: Pose


@dataclass(frozen=True)
class RefinedCase:
    """ADD before and after in diameters of the object (inf without a pose), and the result."""

    before: float
    after: float
    result: TrackingResult


def make_cases(
    meshes: Sequence[Mesh],
    photos: Sequence[np.ndarray],
    renderer: Renderer,
    *,
    cluster: str,
    occluded: float,
    number: int,
    seed: int = 0,
) -> Iterator[Case]:
    """`number` cases, the objects in turn; `covered` is the share of cases with an occluder."""
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
        picture = _put(picture, mesh, truth, renderer, generator)
        if random.random() < occluded:
            card_photo = photos[int(random.integers(len(photos)))]
            picture = _occlude(picture, card_photo, mesh, truth, random)
        picture = picture * random.uniform(0.8, 1.2)
        picture += 0.01 * torch.randn(picture.shape, generator=generator)
        image = (picture.clamp(0, 1) * 255).round().to(torch.uint8).permute(1, 2, 0)
        yield Case(Target(image, CAMERA, mesh, mesh.outer(start)), mesh.outer(truth))


def run_cases(
    cases: Sequence[Case],
    policy: Policy,
    renderer: Renderer,
    config: TrackerConfig = LOOP_ONLY,
    batch: int = 16,
) -> Iterator[RefinedCase]:
    """Refine the cases in batches, as `PoseEstimator` does, and measure them."""
    points: dict[Mesh, Tensor] = {}
    for begin in range(0, len(cases), batch):
        part = cases[begin : begin + batch]
        targets = [case.target for case in part]
        results = refine_single(
            targets,
            policy=policy,
            renderer=renderer,
            config=config,
        )
        for case, result in zip(part, results, strict=True):
            mesh = case.target.mesh
            if mesh not in points:
                points[mesh] = torch.from_numpy(mesh.sample_points(1000))
            before = float(add(case.target.pose, case.truth, points[mesh])) / mesh.diameter
            after = np.inf
            if result.pose is not None:
                after = float(add(result.pose, case.truth, points[mesh])) / mesh.diameter
            yield RefinedCase(before, after, result)


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
    picture: Tensor, mesh: Mesh, truth: Pose, renderer: Renderer, generator: torch.Generator
) -> Tensor:
    """The picture with the lit object in it, rendered finely in a look-at view and warped in."""
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
    lit = light(
        buffer.albedo, buffer.normal, depth, buffer.mask, distance, LightConfig(), generator
    )
    layer = torch.cat([lit * buffer.mask, buffer.mask], 1)
    scale = float(matrix[0, 0]) / CAMERA.fx
    if scale > 1:  # the picture is coarser: blur first, or edges alias
        from kornia.filters import gaussian_blur2d

        width = 2 * int(2 * scale) + 1
        layer = gaussian_blur2d(layer, (width, width), (0.45 * scale, 0.45 * scale))
    back = torch.linalg.inv(crop_homography(fine, CAMERA.matrix))[None].float()
    warped: Tensor = warp_perspective(
        layer, back, (CAMERA.height, CAMERA.width), align_corners=True
    )[0]
    return picture * (1 - warped[3:]) + warped[:3]


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
