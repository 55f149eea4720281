"""A board held in front of an object so that it hides the same share of it in every frame.

Never shades and never decides how much. As in the Laval sequences the board hides the object from
below (`h`, its edge lies level) or from one side (`v`, its edge stands upright).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...rendering.renderer import Renderer
from ...typing import Float64
from ..objects.occluders import board
from .layers import silhouette
from .motion import Motion
from .occlusion import outline_window

Side = Literal["h", "v"]
EVERY = 2.0  # frames between two places where the edge is measured
TILT = 4.0  # degrees that nobody's hand is better than
SMOOTH = np.array([0.25, 0.5, 0.25])


@dataclass(frozen=True)
class BoardOccluder:
    """A board that goes with the object; `edge` is how far from its centre it begins, pixels."""

    kind: str
    mesh: Mesh
    motion: Motion
    along: Float64  # (2,), image direction from the edge into the board
    moments: Float64  # (N,) frames
    edge: Float64  # (N,)
    gap: float  # metres that it is nearer than the object's centre
    middle: Float64  # (3,), of the board's edge in its own frame

    def present(self, frame: float) -> bool:
        """Always."""
        return True

    def poses(self, times: Float64) -> Pose:
        """The board's centred poses at the moments (B,)."""
        return Pose.stack([self._pose(float(time)) for time in times])

    def _pose(self, time: float) -> Pose:
        u, v, depth = self.motion.pixel(np.asarray(time)).tolist()
        x, y = np.array([u, v]) + self.along * np.interp(time, self.moments, self.edge)
        camera, z = self.motion.camera, depth - self.gap
        place = torch.tensor(
            [(x - camera.cx) / camera.fx * z, (y - camera.cy) / camera.fy * z, z],
            dtype=torch.float64,
        )
        a, b = self.along
        turn = torch.tensor([[b, a, 0.0], [-a, b, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
        return Pose(turn, place - turn @ torch.from_numpy(self.middle))


def plan_board_occluder(
    rng: np.random.Generator,
    renderer: Renderer,
    mesh: Mesh,
    motion: Motion,
    frames: int,
    *,
    side: Side,
    share: float,
    photos: Sequence[NDArray[np.uint8]] | None = None,
) -> BoardOccluder:
    """A board that hides `share` of the object's silhouette from below or from a side.

    The edge is placed where that share of the silhouette's pixels lies beyond it, every few frames,
    and moves smoothly in between.
    """
    degrees = 90.0 if side == "h" else float(rng.choice([0.0, 180.0]))
    angle = np.radians(degrees + rng.uniform(-TILT, TILT))
    along = np.array([np.cos(angle), np.sin(angle)])
    size = mesh.sphere_diameter
    face, thickness = board(rng, (1.8 * size, 1.3 * size), photos), 0.02 * size
    moments = np.arange(-1.0, frames + EVERY, EVERY)
    edge = np.array(
        [_edge(renderer, mesh, motion, float(m), along, share) for m in moments.clip(0, frames - 1)]
    )
    padded = np.pad(edge, 1, mode="edge")
    return BoardOccluder(
        kind=f"board {side}",
        mesh=face,
        motion=motion,
        along=along,
        moments=moments,
        edge=np.convolve(padded, SMOOTH, mode="valid"),
        gap=0.52 * size + thickness,
        middle=np.array([0.0, -0.65 * size, 0.0]) - face.center,
    )


def _edge(
    renderer: Renderer, mesh: Mesh, motion: Motion, time: float, along: Float64, share: float
) -> float:
    """Pixels from the object's centre beyond which `share` of its silhouette lies."""
    camera: Camera = motion.camera
    pose = motion.pose(time)
    window = outline_window(mesh, pose, camera)
    rows, columns = np.nonzero(silhouette(renderer, mesh, pose, camera, window))
    u, v, _ = motion.pixel(np.asarray(time)).tolist()
    pixels = np.stack([columns + window[0] - u, rows + window[1] - v], 1)
    return float(np.quantile(pixels @ along, 1 - share))
