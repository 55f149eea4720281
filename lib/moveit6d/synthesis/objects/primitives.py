"""Building blocks of procedural objects: curved patches with texture coordinates, and bends.

Never paints and never knows `Mesh`; sizes are free until `shapes` scales the whole object.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ...typing import Float64


@dataclass(frozen=True)
class Part:
    """One piece of surface. Parts of the same `skin` share one tile of the texture.

    `uv` is in [0, 1]² with v pointing up; `charts` says into how many columns and rows it is cut
    (a box has 3 × 2, one a side).
    """

    vertices: Float64  # (V, 3)
    faces: NDArray[np.int64]  # (F, 3)
    uv: Float64  # (V, 2)
    skin: int = 0
    charts: tuple[int, int] = (1, 1)

    def moved(self, offset: object, skin: int | None = None) -> Part:
        """The part shifted by `offset` (3,), perhaps with another skin."""
        place = self.vertices + np.asarray(offset, np.float64)
        return replace(self, vertices=place, skin=self.skin if skin is None else skin)

    def turned(self, rotation: Float64) -> Part:
        """The part after a rotation (3, 3) about the origin."""
        return replace(self, vertices=self.vertices @ rotation.T)

    def scaled(self, factors: object) -> Part:
        """The part stretched along the axes, all factors positive or mirrored (faces then turn)."""
        sizes = np.broadcast_to(np.asarray(factors, np.float64), (3,))
        faces = self.faces[:, ::-1] if np.prod(sizes) < 0 else self.faces
        return replace(self, vertices=self.vertices * sizes, faces=faces)


def sheet(points: Float64) -> Part:
    """A grid of points (rows, columns, 3) as a surface; u runs along columns, v down the rows."""
    rows, columns = points.shape[:2]
    index = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.concatenate(
        [np.stack([a, b, c], -1).reshape(-1, 3), np.stack([a, c, d], -1).reshape(-1, 3)]
    )
    v, u = np.meshgrid(np.linspace(1, 0, rows), np.linspace(0, 1, columns), indexing="ij")
    vertices = points.reshape(-1, 3)
    corners = vertices[faces]
    area = np.linalg.norm(
        np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1
    )
    kept = faces[area > 1e-12 * max(float(area.max()), 1e-300)]  # at poles a row is one point
    return Part(vertices, kept, np.stack([u, v], -1).reshape(-1, 2))


def superquadric(
    sizes: object, rounding: Sequence[float] | Float64 = (1.0, 1.0), detail: int = 20
) -> Part:
    """An ellipsoid, rounded box (`rounding` towards 0.2) or spindle (2) with half axes `sizes`.

    `rounding` holds the exponents up and down, and around.
    """
    v = np.linspace(np.pi / 2, -np.pi / 2, detail)[:, None]
    u = np.linspace(-np.pi, np.pi, detail * 2 - 7)[None]
    cos_v, sin_v = _power(np.cos(v), rounding[0]), _power(np.sin(v), rounding[0])
    cos_u, sin_u = _power(np.cos(u), rounding[1]), _power(np.sin(u), rounding[1])
    points = np.stack([cos_v * cos_u, cos_v * sin_u, sin_v * np.ones_like(u)], -1)
    return sheet(points * np.asarray(sizes, np.float64))


def lathe(radii: Float64, heights: Float64, around: int = 32) -> Part:
    """A body turned on a lathe about z: radius at each height, from the top of the picture down."""
    angle = np.linspace(0, 2 * np.pi, around + 1)[None]
    r, z = np.asarray(radii, np.float64)[:, None], np.asarray(heights, np.float64)[:, None]
    return sheet(np.stack([r * np.cos(angle), r * np.sin(angle), z * np.ones_like(angle)], -1))


def cylinder(radius: float, height: float, around: int = 24) -> Part:
    """A closed cylinder about z, centred."""
    half = height / 2
    edge = 0.97 * radius
    radii = np.array([0.0, edge, radius, radius, edge, 0.0])
    return lathe(radii, np.array([half, half, 0.97 * half, -0.97 * half, -half, -half]), around)


def box(sizes: object, detail: int = 4) -> Part:
    """A box with edges of the given lengths, centred; each side has a chart of its own."""
    half = np.asarray(sizes, np.float64) / 2
    line = np.linspace(-1, 1, detail + 1)
    y, x = np.meshgrid(line[::-1], line, indexing="ij")
    flat = np.stack([x, y, np.ones_like(x)], -1)
    sides = []
    for number, (axis, sign) in enumerate((a, s) for a in range(3) for s in (1.0, -1.0)):
        turn = np.zeros((3, 3))
        turn[axis, 2] = sign
        turn[(axis + 1) % 3, 0], turn[(axis + 2) % 3, 1] = sign, 1.0
        side = sheet((flat @ turn.T) * half)
        column, row = number % 3, number // 3
        inside = 0.01 + 0.98 * side.uv  # a margin, so that sides do not bleed into each other
        sides.append(replace(side, uv=(inside + (column, row)) / (3, 2)))
    return replace(join(sides), charts=(3, 2))


def tube(path: Float64, radius: float | Float64, around: int = 12) -> Part:
    """A round tube along a path (N, 3), closed at its ends."""
    path = np.asarray(path, np.float64)
    radii = np.broadcast_to(np.asarray(radius, np.float64), (len(path),))
    along = np.gradient(path, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    side = np.cross(along[0], np.eye(3)[np.abs(along[0]).argmin()])
    rings = [path[:1].repeat(around + 1, 0)]
    angle = np.linspace(0, 2 * np.pi, around + 1)[:, None]
    for point, forward, r in zip(path, along, radii, strict=True):
        side = side - forward * (side @ forward)
        side /= np.linalg.norm(side)
        up = np.cross(forward, side)
        rings.append(point + r * (np.cos(angle) * side + np.sin(angle) * up))
    rings.append(path[-1:].repeat(around + 1, 0))
    return sheet(np.stack(rings))


def prism(outline: Float64, height: float) -> Part:
    """An outline (N, 2), star-shaped about the origin, extruded along z, with slight bevels."""
    ring = np.concatenate([outline, outline[:1]])
    inner = 0.96 * ring
    half = height / 2
    steps = [
        (0 * ring, half),
        (inner, half),
        (ring, 0.9 * half),
        (ring, -0.9 * half),
        (inner, -half),
        (0 * ring, -half),
    ]
    rows = [np.concatenate([xy, np.full((len(ring), 1), z)], 1) for xy, z in steps]
    part = sheet(np.stack(rows))
    # Seen from above and below the texture lies flat on the outline.
    reach = np.abs(outline).max()
    flat = 0.5 + 0.5 * part.vertices[:, :2] / reach
    return replace(part, uv=np.clip(flat, 0, 1))


def join(parts: list[Part]) -> Part:
    """Several parts as one of the first one's skin; the texture coordinates stay."""
    starts = np.cumsum([0] + [len(part.vertices) for part in parts[:-1]])
    return Part(
        np.concatenate([part.vertices for part in parts]),
        np.concatenate([part.faces + start for part, start in zip(parts, starts, strict=True)]),
        np.concatenate([part.uv for part in parts]),
        parts[0].skin,
    )


# -- deformations of points (V, 3) that lie within about [-1, 1]³ ----------------------------------


def bumps(rng: np.random.Generator, points: Float64, amount: float, waves: int = 5) -> Float64:
    """Push points in and out by smooth waves; equal points stay equal."""
    moved = points.copy()
    for _ in range(waves):
        direction = rng.standard_normal(3)
        direction /= np.linalg.norm(direction)
        frequency, phase = rng.uniform(2, 7), rng.uniform(0, 2 * np.pi)
        wave = np.sin(points @ direction * frequency + phase)
        moved += amount / waves * wave[:, None] * (points + 0.3 * rng.standard_normal(3))
    return moved


def twist(points: Float64, radians: float) -> Float64:
    """Turn about z, the more the higher."""
    angle = radians * points[:, 2]
    c, s = np.cos(angle), np.sin(angle)
    x, y = points[:, 0], points[:, 1]
    return np.stack([c * x - s * y, s * x + c * y, points[:, 2]], -1)


def taper(points: Float64, amount: float) -> Float64:
    """Thinner upwards (amount > 0) or downwards."""
    scale = 1 - amount * points[:, 2:]
    return np.concatenate([points[:, :2] * scale, points[:, 2:]], 1)


def bend(points: Float64, amount: float) -> Float64:
    """Lean over along x, as a banana does."""
    moved = points.copy()
    moved[:, 0] += amount * points[:, 2] ** 2
    return moved


def rotation(rng: np.random.Generator) -> Float64:
    """A rotation matrix (3, 3), evenly distributed."""
    q, r = np.linalg.qr(rng.standard_normal((3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q if np.linalg.det(q) > 0 else q[:, [1, 0, 2]])


def about(axis: int, radians: float) -> Float64:
    """The rotation (3, 3) about coordinate axis 0, 1 or 2."""
    c, s = np.cos(radians), np.sin(radians)
    turn = np.eye(3)
    i, j = (axis + 1) % 3, (axis + 2) % 3
    turn[i, i], turn[i, j], turn[j, i], turn[j, j] = c, -s, s, c
    return turn


def _power(values: Float64, exponent: float) -> Float64:
    return np.asarray(np.sign(values) * np.abs(values) ** exponent)
