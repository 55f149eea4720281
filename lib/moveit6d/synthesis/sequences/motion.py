"""Smooth, hand-like motion: an object's pose at any moment of a clip, from a seed and two speeds.

Never renders. Time is counted in frames and may be fractional; poses are of the centred object.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import torch

from ...geometry.camera import Camera
from ...geometry.pose import Pose
from ...geometry.rotation import exp_so3
from ...typing import Float64

SUBSTEPS = 16  # of a frame, where turning speed is integrated
_TURNS = 5  # sines a coordinate


class SmoothPath:
    """A random smooth curve through [-1, 1]ⁿ: sums of slow sines. Never leaves it."""

    def __init__(self, rng: np.random.Generator, axes: int) -> None:
        self._frequency = rng.uniform(0.4, 1.6, (_TURNS, axes))
        self._phase = rng.uniform(0, 2 * np.pi, (_TURNS, axes))
        weight = rng.uniform(0.3, 1.0, (_TURNS, axes)) / self._frequency
        self._weight = weight / weight.sum(0)

    def __call__(self, time: float | Float64) -> Float64:
        """The point (..., axes) at time (...); one unit of time is about one radian."""
        moment = np.asarray(time, np.float64)[..., None, None]
        return np.asarray((self._weight * np.sin(self._frequency * moment + self._phase)).sum(-2))


@dataclass(frozen=True)
class Motion:
    """Where an object is at each moment: pixel of its centre, depth in metres and rotation."""

    camera: Camera
    path: SmoothPath  # of the pixel and the depth
    rate: float  # radians of the path a frame
    center: tuple[float, float]  # pixels
    reach: tuple[float, float]  # pixels
    depth: float
    depth_change: float  # natural logarithm of the largest factor
    rotations: torch.Tensor  # (frames × SUBSTEPS, 3, 3) from one step before frame 0 on

    def pose(self, time: float) -> Pose:
        """The centred object's pose (float64) at a moment between frames -1 and `frames`."""
        u, v, depth = self.pixel(np.asarray(time)).tolist()
        x = (u - self.camera.cx) / self.camera.fx * depth
        y = (v - self.camera.cy) / self.camera.fy * depth
        return Pose(self.rotation(time), torch.tensor([x, y, depth], dtype=torch.float64))

    def pixel(self, time: Float64) -> Float64:
        """Column, row and depth (..., 3) of the object's centre at the moments (...)."""
        way = self.path(np.asarray(time) * self.rate)
        u = self.center[0] + self.reach[0] * way[..., 0]
        v = self.center[1] + self.reach[1] * way[..., 1]
        return np.stack([u, v, self.depth * np.exp(self.depth_change * way[..., 2])], -1)

    def rotation(self, time: float) -> torch.Tensor:
        """The rotation (3, 3), between two substeps on the shortest way."""
        place = (time + 1) * SUBSTEPS
        index = min(max(math.floor(place), 0), len(self.rotations) - 2)
        first, second = self.rotations[index], self.rotations[index + 1]
        # Two substeps are a fraction of a degree apart: the first-order step is exact enough, and
        # the exponential keeps the result a rotation.
        turn = second @ first.mT
        skew = 0.5 * (turn - turn.mT)
        vector = torch.stack([skew[2, 1], skew[0, 2], skew[1, 0]])
        return exp_so3(vector * (place - index)) @ first


def random_motion(
    rng: np.random.Generator,
    camera: Camera,
    sphere_diameter: float,
    frames: int,
    *,
    pixels_per_frame: float,
    degrees_per_frame: float,
    margin: float = 1.0,
    change_depth: float = 0.25,
) -> Motion:
    """A motion whose fastest moment has the given speeds in the image and in turning.

    The object spans a sixth to a third of the frame's width; its centre keeps `margin` of its
    radius away from the frame's edges. Near the end of its depth range it may be slower.
    """
    smaller = min(camera.width, camera.height * 4 / 3)
    span = rng.uniform(0.17, 0.32) * smaller
    depth = camera.fx * sphere_diameter / span
    change = rng.uniform(0.4, 1.0) * change_depth
    radius = 0.5 * span * math.exp(change) * margin
    reach = (
        max(0.08 * camera.width, 0.5 * camera.width - radius),
        max(0.08 * camera.height, 0.5 * camera.height - radius),
    )
    path = SmoothPath(rng, 3)
    motion = Motion(
        camera=camera,
        path=path,
        rate=_rate(path, reach, frames, pixels_per_frame),
        center=((camera.width - 1) / 2, (camera.height - 1) / 2),
        reach=reach,
        depth=depth,
        depth_change=change,
        rotations=_rotations(rng, frames, degrees_per_frame),
    )
    return motion


def _rate(path: SmoothPath, reach: tuple[float, float], frames: int, speed: float) -> float:
    """Radians of the path a frame so that its fastest moment has this speed in pixels a frame.

    The faster, the more of the path is gone through, so that the fastest moment's speed only grows
    with the rate: halve the interval.
    """

    def fastest(rate: float) -> float:
        way = path(np.linspace(0, frames - 1, 8 * frames) * rate)[:, :2] * reach
        moment = (frames - 1) / (8 * frames - 1)
        return float(np.linalg.norm(np.diff(way, axis=0), axis=1).max()) / moment

    low, high = 0.0, speed / min(reach)
    while fastest(high) < speed:
        high *= 2
    for _ in range(30):
        middle = 0.5 * (low + high)
        low, high = (middle, high) if fastest(middle) < speed else (low, middle)
    return high


def _rotations(rng: np.random.Generator, frames: int, degrees: float) -> torch.Tensor:
    """Rotations (steps, 3, 3) every 1 / SUBSTEPS frame from frame -1 to frame `frames`."""
    steps = (frames + 2) * SUBSTEPS
    turning = SmoothPath(rng, 3)
    # The axis wanders about once in 40 frames, slower for slow turning.
    pace = 2 * np.pi / 40 * min(1.0, degrees / 4 + 0.3)
    speed = turning(np.arange(steps) * pace / SUBSTEPS)
    speed *= math.radians(degrees) / max(float(np.linalg.norm(speed, axis=1).max()), 1e-9)
    small = exp_so3(torch.from_numpy(speed / SUBSTEPS))
    current = exp_so3(torch.from_numpy(_uniform_turn(rng)))
    rotations = []
    for step in small:
        rotations.append(current)
        current = step @ current
    return torch.stack(rotations)


def _uniform_turn(rng: np.random.Generator) -> Float64:
    """A rotation vector whose rotation is evenly distributed."""
    q = rng.standard_normal(4)
    q /= np.linalg.norm(q)
    angle = 2 * math.acos(min(1.0, abs(q[0])))
    axis = q[1:] / max(float(np.linalg.norm(q[1:])), 1e-12)
    return np.asarray(axis * angle * math.copysign(1, q[0]))
