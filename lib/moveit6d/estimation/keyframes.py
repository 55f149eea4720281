"""What an object looked like in earlier frames, shown again as it would look at another pose.

Never moves a pose and never asks a policy. The paper's future work: knowledge built up over time.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import torch
from kornia.geometry.transform import remap
from torch import Tensor
from torch.nn import functional

from ..config import KeyframeConfig
from ..frame import Frame
from ..geometry.crop import PATCH_SIZE, Crop, View, crop_patch, look_at, patch_pixels, view_of
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..observation import Observation
from ..rendering.attributes import pixel_rays
from ..rendering.renderer import Renderer

ZOOM = 2  # pixels of a keyframe to one of a crop, each way: the fine stage shows it enlarged
SIZE = ZOOM * PATCH_SIZE
DEFAULT = KeyframeConfig()


@dataclass(frozen=True)
class Keyframe:
    """A frame's picture of an object at a known pose.

    `layers` (4, S, S) are a `picture` and a `weight`, `depth` (1, S, S) in metres is the mesh's.
    `pose` is centred, float64, in the frame of the crop's camera; `intrinsics` (3, 3) are that
    camera's.
    """

    layers: Tensor
    depth: Tensor
    pose: Pose
    intrinsics: Tensor

    @property
    def picture(self) -> Tensor:
        """A look-at crop (3, S, S) in [0, 1]."""
        return self.layers[:3]

    @property
    def weight(self) -> Tensor:
        """Where the picture shows the surface well: (1, S, S) in [0, 1]."""
        return self.layers[3:]

    @cached_property
    def side(self) -> Tensor:
        """From the object towards the camera: a unit vector (3,) in the centred frame."""
        return _towards_camera(self.pose)

    @staticmethod
    def take(
        frame: Frame,
        mesh: Mesh,
        centred: Pose,
        renderer: Renderer,
        config: KeyframeConfig = DEFAULT,
    ) -> Keyframe:
        """What a frame shows of an object at a centred pose."""
        view = _enlarged(look_at(centred, torch.tensor(mesh.sphere_diameter).double()))
        pose = view.to_virtual(centred)
        buffer = renderer.render([mesh], pose[None], view.intrinsics[None], SIZE)
        depth = buffer.depth[0]
        rays = _rays(view.intrinsics, SIZE)
        facing = -(buffer.normal[0] * rays).sum(0, keepdim=True) / rays.norm(dim=0, keepdim=True)
        weight = _ramp(facing, *config.facing) * _off_edges(depth, mesh.sphere_diameter, config)
        picture = crop_patch(frame.pixels, view, frame.intrinsics, frame.camera.lens, SIZE)
        layers = torch.cat([picture, weight * _in_image(frame, view)])
        return Keyframe(layers, depth, pose, view.intrinsics)

    def look_up(
        self, points: Tensor, diameter: float, config: KeyframeConfig = DEFAULT
    ) -> tuple[Tensor, Tensor]:
        """Colours (3, H, W) and weights (1, H, W) of points (3, H, W) in the centred frame."""
        turn, shift = self.pose.rotation.float(), self.pose.translation.float()
        placed = torch.einsum("ij,jhw->ihw", turn, points) + shift[:, None, None]
        projected = torch.einsum("ij,jhw->ihw", self.intrinsics.float(), placed)
        u, v = (projected[:2] / projected[2:].clamp(min=1e-6)).unbind()
        found: Tensor = remap(self.layers[None], u[None], v[None], align_corners=True)[0]
        grid = torch.stack([u, v], -1)[None] * (2 / (SIZE - 1)) - 1
        depth = functional.grid_sample(self.depth[None], grid, "nearest", align_corners=True)[0]
        seen = (placed[2:] - depth).abs() < config.hidden * diameter
        return found[:3], found[3:] * seen


@dataclass(frozen=True)
class KeyframeMemory:
    """The keyframes of one object, the oldest first, each from another side."""

    config: KeyframeConfig
    kept: tuple[Keyframe, ...] = ()

    def wants(self, centred: Pose, confidence: float) -> bool:
        """Whether a frame is to be kept: a confident one, from a side not yet known."""
        if confidence < self.config.min_confidence or len(self.kept) >= self.config.count:
            return False
        side = _towards_camera(centred)
        return all(_angle(one.side, side) > self.config.spread for one in self.kept)

    def add(self, new: Keyframe) -> KeyframeMemory:
        """These and one more."""
        return replace(self, kept=(*self.kept, new))

    def near(self, centred: Pose) -> list[Keyframe]:
        """Those that see much of what is seen at a pose, the oldest first.

        The older a keyframe the fewer poses its own rests on: what it saw counts for good, and
        later ones add what it did not see. A track that always compared with its newest would
        drift.
        """
        side = _towards_camera(centred)
        return [one for one in self.kept if _angle(one.side, side) < self.config.reach]


def recall(
    observation: Observation,
    keyframes: Sequence[KeyframeMemory | None],
    meshes: Sequence[Mesh],
    pose: Pose,
    sphere_diameter: Tensor,
    crop: Crop = "look_at",
) -> Observation:
    """The observation with renderings (B) that take the colours of keyframes where these have any.

    Poses (B) are centred and `sphere_diameter` (B,) fills the crops, as in `observe`.
    """
    rows = [row for row, known in enumerate(keyframes) if known is not None and known.kept]
    if not rows:
        return observation
    view = view_of(pose, sphere_diameter, crop)
    virtual = view.to_virtual(pose)
    rendering = observation.rendering.clone()
    for row in rows:
        known = keyframes[row]
        assert known is not None
        config, sphere = known.config, meshes[row].sphere_diameter
        middle, size = view.distance[row].float(), sphere_diameter[row].float()
        placed = _rays(view.intrinsics[row], PATCH_SIZE) * (observation.depth[row] * size + middle)
        turn, shift = virtual.rotation[row].float(), virtual.translation[row].float()
        points = torch.einsum("ji,jhw->ihw", turn, placed - shift[:, None, None])
        colour, total = torch.zeros_like(rendering[row]), torch.zeros_like(observation.mask[row])
        for one in known.near(pose[row]):
            found, weight = one.look_up(points, sphere, config)
            weight = weight * observation.mask[row] * (1 - total)
            colour, total = colour + weight * found, total + weight
            if float(total.sum()) > config.enough * float(observation.mask[row].sum()):
                break
        rendering[row] = _completed(rendering[row], colour, total, config)
    return replace(observation, rendering=rendering)


def _completed(rendering: Tensor, colour: Tensor, total: Tensor, config: KeyframeConfig) -> Tensor:
    """Remembered colours (3, H, W), times their weights (1, H, W), and a rendering for the rest.

    The rendering takes on their brightness and tint: a seam would look like an edge of the object.
    """
    if float(total.sum()) < config.min_pixels:
        return rendering
    own = (rendering * total).sum((1, 2))
    gain = (colour.sum((1, 2)) / own.clamp(min=1e-3)).clamp(*config.gain)
    return colour + (1 - total) * (rendering * gain[:, None, None]).clamp(max=1)


def _angle(one: Tensor, other: Tensor) -> float:
    """Degrees between two unit vectors (3,)."""
    return math.degrees(math.acos(min(1.0, max(-1.0, float(one @ other)))))


def _towards_camera(centred: Pose) -> Tensor:
    """Unit vector (3,) in the object's frame."""
    back = -(centred.rotation.mT @ centred.translation)
    direction: Tensor = back / back.norm()
    return direction


def _enlarged(view: View) -> View:
    """The same view in a picture of `SIZE` pixels."""
    matrix = view.intrinsics.clone()
    matrix[:2] *= ZOOM
    matrix[:2, 2] += (ZOOM - 1) / 2  # pixel (0, 0) is a pixel's centre
    return View(view.rotation, matrix, view.distance)


def _rays(intrinsics: Tensor, size: int) -> Tensor:
    """Rays (3, size, size), float32, through a picture's pixels; z is 1."""
    rays = pixel_rays(np.arange(size * size), intrinsics.numpy(), size)
    return torch.from_numpy(rays).view(3, size, size)


def _ramp(values: Tensor, low: float, high: float) -> Tensor:
    """0 up to `low`, 1 from `high` on."""
    return ((values - low) / (high - low)).clamp(0, 1)


def _off_edges(depth: Tensor, diameter: float, config: KeyframeConfig) -> Tensor:
    """How far the pixels of a depth map (1, S, S) are from outlines and edges of depth: 0 to 1."""
    import cv2

    surface, kernel = depth[0].numpy(), np.ones((3, 3), np.uint8)
    jump = cv2.dilate(surface, kernel) - cv2.erode(surface, kernel) > config.depth_edge * diameter
    inner = ((surface > 0) & ~jump).astype(np.uint8)
    distance = torch.from_numpy(cv2.distanceTransform(inner, cv2.DIST_L2, 3))[None]
    return _ramp(distance, *config.edge_margin)


def _in_image(frame: Frame, view: View) -> Tensor:
    """1 where an enlarged view lies in the image, else 0: (1, S, S)."""
    u, v = patch_pixels(view, frame.intrinsics, frame.camera.lens, SIZE)
    height, width = frame.pixels.shape[-2:]
    inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
    return inside.float()[None]
