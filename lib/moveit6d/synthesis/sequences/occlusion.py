"""When and where things pass in front of an object, and how much of it they leave in sight.

Never shades.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np
import torch
from numpy.typing import NDArray

from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...geometry.rotation import exp_so3
from ...rendering.renderer import Renderer
from ...typing import Float64
from ..objects.occluders import Occluder, random_occluder
from .layers import bounds, silhouette
from .motion import Motion, SmoothPath


class MovingOccluder(Protocol):
    """Whatever may stand in front of an object: its mesh, when it is there, and where."""

    @property
    def kind(self) -> str:
        """What it is, in a word."""

    @property
    def mesh(self) -> Mesh:
        """Its surface."""

    def present(self, frame: float) -> bool:
        """Whether it is about at a frame."""

    def poses(self, times: Float64) -> Pose:
        """Its centred poses at the moments (B,)."""


@dataclass
class PassingOccluder:
    """One occluder that comes from outside, stays in front of the object for a while, and leaves.

    Its leading point keeps `near` pixels from the object's centre in the image at the closest, in
    direction `angle`; `plan_passing_occluders` sets `near` so that the right share is occluded.
    """

    occluder: Occluder
    motion: Motion  # of the object
    start: float  # frame
    length: float  # frames
    angle: float
    far: float  # pixels
    depth: float  # metres nearer than the object's centre
    turn: torch.Tensor  # (3, 3)
    wobble: SmoothPath
    near: float = 0.0

    @property
    def kind(self) -> str:
        """What passes."""
        return self.occluder.kind

    @property
    def mesh(self) -> Mesh:
        """Its surface."""
        return self.occluder.mesh

    def present(self, frame: float) -> bool:
        """Whether the occluder is about at a frame (a little generously)."""
        return self.start - 1 <= frame <= self.start + self.length + 1

    def poses(self, times: Float64) -> Pose:
        """The occluder's centred poses at the moments (B,)."""
        return Pose.stack([self._pose(float(time)) for time in times])

    def _pose(self, time: float) -> Pose:
        share = (time - self.start) / self.length
        there = _smooth(min(share, 1 - share) / 0.3)
        away = self.far + there * (self.near - self.far)
        x, y, turn = self.wobble(time * 0.15) * (4.0, 4.0, 0.12)
        u, v, depth = self.motion.pixel(np.asarray(time)).tolist()
        u += away * np.cos(self.angle) + x
        v += away * np.sin(self.angle) + y
        z = depth - self.depth
        camera = self.motion.camera
        tip = torch.tensor(
            [(u - camera.cx) / camera.fx * z, (v - camera.cy) / camera.fy * z, z],
            dtype=torch.float64,
        )
        rotation = exp_so3(torch.tensor([0.0, 0.0, turn], dtype=torch.float64)) @ self.turn
        return Pose(rotation, tip - rotation @ torch.from_numpy(self.occluder.tip))


def plan_passing_occluders(
    rng: np.random.Generator,
    renderer: Renderer,
    mesh: Mesh,
    motion: Motion,
    frames: int,
    *,
    share: float,
    occlusion: tuple[float, float],
    photos: Sequence[NDArray[np.uint8]] | None = None,
) -> list[PassingOccluder]:
    """Occluders over about `share` of the frames, each hiding a part drawn from `occlusion`."""
    if share * frames < 6:
        return []
    count = max(1, min(3, round(share * frames / 30)))
    # The object is occluded for about two thirds of the time that an occluder is there.
    length = share * frames / count * 1.5
    room = frames / count
    occluders = []
    for number in range(count):
        slack = max(room - length, 0.0)
        start = number * room + rng.uniform(0.2, 0.8) * slack
        passing = _passing_occluder(rng, mesh, motion, max(start, 2.0), min(length, room), photos)
        _come_near(renderer, mesh, passing, rng.uniform(*occlusion), occlusion[1])
        occluders.append(passing)
    return occluders


def visible_fraction(
    renderer: Renderer, mesh: Mesh, motion: Motion, occluders: Sequence[MovingOccluder], time: float
) -> float:
    """Share of the object's silhouette that is inside the frame and not occluded."""
    return visible_share(renderer, mesh, motion.pose(time), motion.camera, occluders, time)


def visible_share(
    renderer: Renderer,
    mesh: Mesh,
    pose: Pose,
    camera: Camera,
    occluders: Sequence[MovingOccluder],
    time: float,
) -> float:
    """Share of the silhouette at a centred pose that is inside the frame and not occluded."""
    window = outline_window(mesh, pose, camera)
    left, top, _ = window
    depth = silhouette(renderer, mesh, pose, camera, window)
    seen = depth > 0
    total = int(seen.sum())
    line = np.arange(window[2])
    seen &= ((line + left >= 0) & (line + left < camera.width))[None]
    seen &= ((line + top >= 0) & (line + top < camera.height))[:, None]
    for occluder in occluders:
        if occluder.present(time):
            place = occluder.poses(np.array([time]))[0]
            before = silhouette(renderer, occluder.mesh, place, camera, window)
            seen &= (before == 0) | (before > depth)
    return float(seen.sum()) / max(total, 1)


def outline_window(mesh: Mesh, pose: Pose, camera: Camera) -> tuple[int, int, int]:
    """Left, top and size of a square that holds the object's whole silhouette, frame or not."""
    batch = Pose(pose.rotation[None], pose.translation[None])
    box = bounds(mesh, batch, camera) or (0, 0, camera.width, camera.height)
    left, top = int(box[0]) - 2, int(box[1]) - 2
    return left, top, int(max(box[2] - box[0], box[3] - box[1])) + 6


def _passing_occluder(
    rng: np.random.Generator,
    mesh: Mesh,
    motion: Motion,
    start: float,
    length: float,
    photos: Sequence[NDArray[np.uint8]] | None,
) -> PassingOccluder:
    occluder = random_occluder(rng, mesh.sphere_diameter / 0.2, photos)
    # A hand comes from below or the sides, other things from anywhere.
    hand = occluder.along is not None
    angle = rng.uniform(0.0, np.pi) if hand else rng.uniform(0, 2 * np.pi)
    turn = _facing(rng, occluder, angle)
    reach = occluder.mesh.vertices.astype(np.float64) @ turn.numpy().T
    tip = turn.numpy() @ occluder.tip
    thickness = float(reach[:, 2].max() - tip[2])  # how far it reaches behind its tip
    depth = 0.52 * mesh.sphere_diameter + thickness + 0.03 * mesh.sphere_diameter
    nearest = motion.depth * np.exp(-motion.depth_change)
    depth = min(depth, 0.6 * nearest)
    span = motion.camera.fx / (motion.depth - depth) * np.linalg.norm(reach[:, :2], axis=1).max()
    return PassingOccluder(
        occluder=occluder,
        motion=motion,
        start=start,
        length=length,
        angle=angle,
        far=0.7 * motion.camera.width + (0.0 if hand else float(span)),
        depth=depth,
        turn=turn,
        wobble=SmoothPath(rng, 3),
    )


def _facing(rng: np.random.Generator, occluder: Occluder, angle: float) -> torch.Tensor:
    """Turns the occluder: a hand's arm along the image direction `angle`, the rest at random."""
    tilt = exp_so3(torch.from_numpy(rng.uniform(-0.35, 0.35, 3) * (1, 1, 0)))
    if occluder.along is None:
        free = rng.uniform(-np.pi, np.pi)
        if occluder.kind == "object":
            tilt = exp_so3(torch.from_numpy(rng.uniform(-2, 2, 3)))
        return tilt @ exp_so3(torch.tensor([0, 0, free], dtype=torch.float64))
    along = occluder.along
    own = float(np.arctan2(along[1], along[0]))
    turn = exp_so3(torch.tensor([0, 0, angle - own], dtype=torch.float64))
    over = np.pi if rng.random() < 0.5 else 0.0  # palm or back of the hand
    flip = exp_so3(torch.tensor([0.0, over, 0.0], dtype=torch.float64))
    return tilt @ turn @ flip


def _come_near(
    renderer: Renderer, mesh: Mesh, passing: PassingOccluder, goal: float, most: float
) -> None:
    """Set how near the occluder comes: `goal` hidden in the middle, never more than `most`."""
    middle = passing.start + passing.length / 2

    def occlusion(near: float, time: float) -> float:
        passing.near = near
        alone = visible_fraction(renderer, mesh, passing.motion, (), time)
        return alone - visible_fraction(renderer, mesh, passing.motion, (passing,), time)

    # From far to near ever more is hidden; past the centre (negative) less again.
    radius = 0.5 * passing.motion.camera.fx * mesh.sphere_diameter / passing.motion.depth
    low, high = -0.3 * radius, passing.far
    for _ in range(12):
        trial = 0.5 * (low + high)
        if occlusion(trial, middle) > goal:
            low = trial
        else:
            high = trial
    near = high
    moments = np.linspace(passing.start, passing.start + passing.length, 16)
    for _ in range(12):
        if max(occlusion(near, float(time)) for time in moments) <= most:
            break
        near += 0.08 * radius
    passing.near = near


def _smooth(share: float) -> float:
    """From 0 to 1 with a gentle start and end; outside of [0, 1] it stays at its ends."""
    inside = min(max(share, 0.0), 1.0)
    return inside * inside * (3 - 2 * inside)
