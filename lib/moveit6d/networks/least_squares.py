"""From displacements of surface points to the pose delta: closed-form Jacobian, weighted solve.

Never sees images. All lengths are in sphere diameters of the object, so that nothing here depends
on its size; pixels are the patch's.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from ..geometry.crop import OBJECT_SIZE, PATCH_SIZE
from ..geometry.rotation import exp_so3

_DEGREE = math.pi / 180
LONGEST = 40.0  # action units, of a delta on any axis
_SHARPEST = 2.5  # logarithm of how much better than average the better direction may be known


def cell_pixels(stride: int) -> Tensor:
    """Patch pixel (x, y) that stands for each cell of a stride-s grid, row by row: (cells, 2)."""
    line = torch.arange(PATCH_SIZE // stride) * stride + stride // 2
    y, x = torch.meshgrid(line, line, indexing="ij")
    return torch.stack([x, y], -1).reshape(-1, 2)


def object_pixels(mask: Tensor, stride: int) -> tuple[Tensor, Tensor]:
    """The object's pixel (x, y) nearest to the middle of each cell of a stride-s grid, row by row.

    `mask` (B, 1, 128, 128) → whole numbers (B, cells, 2), and (B, cells) 1 where there is one, 0
    where the object has none in the cell; the pixel is that of `cell_pixels` there. A pen may pass
    beside the middles of most of its cells, and its tips nearly always do.
    """
    size = mask.shape[-1]
    line = (torch.arange(size, device=mask.device) % stride - stride // 2).square()
    nearness = 1 / (1 + line[:, None] + line).to(mask)
    outside = 1e-3  # less near than any pixel of the object
    weighed = nearness * (mask + outside)
    index = functional.max_pool2d(weighed, stride, return_indices=True)[1].flatten(1)
    pixels = torch.stack([index % size, index // size], -1)
    return pixels, mask.flatten(1).gather(1, index)


def surface_points(depth: Tensor, distance: Tensor, pixels: Tensor) -> Tensor:
    """Surface points under pixels, virtual camera's frame, diameters: (B, M, 3).

    `depth` (B, 1, 128, 128) relative to the centre and `distance` (B,), as in `Observation`;
    `pixels` (M, 2) or (B, M, 2) whole numbers. Where there is no surface the point lies at the
    centre's depth.
    """
    size = depth.shape[-1]
    x, y = pixels.expand(len(depth), -1, -1).unbind(-1)
    z = depth.flatten(1).gather(1, y * size + x) + distance[:, None]
    focal = OBJECT_SIZE * distance[:, None, None]
    rays = (pixels.to(depth) - (size - 1) / 2) / focal
    return torch.cat([rays * z[..., None], z[..., None]], -1)


def project_points(points: Tensor, distance: Tensor) -> Tensor:
    """Patch pixels of points (B, M, 3) in diameters: (B, M, 2)."""
    focal = OBJECT_SIZE * distance[:, None, None]
    return points[..., :2] / points[..., 2:].clamp_min(1e-6) * focal + (PATCH_SIZE - 1) / 2


def move_points(
    points: Tensor, distance: Tensor, delta: Tensor, direction: Tensor | None = None
) -> Tensor:
    """Surface points (B, M, 3) after a pose delta (B, 6), as `PoseAction.apply_centred` has it.

    In an axis-parallel view `direction` (B, 2) is x / z and y / z of the object's centre. Points
    are then those of `surface_points` still: as if the centre stood straight ahead (`slanted`).
    """
    depth = distance * OBJECT_SIZE / (OBJECT_SIZE + delta[:, 2])
    metres = depth / (OBJECT_SIZE * distance)
    goal = torch.stack([delta[:, 0] * metres, delta[:, 1] * metres, depth], -1)
    start = torch.stack([torch.zeros_like(distance), torch.zeros_like(distance), distance], -1)
    rotation = exp_so3(delta[:, 3:] * _DEGREE)
    around = points - start[:, None]
    if direction is None:
        return around @ rotation.mT + goal[:, None]
    turned = slanted(around, direction) @ rotation.mT
    return slanted(turned, -direction) + goal[:, None]


def slanted(vectors: Tensor, direction: Tensor) -> Tensor:
    """Vectors (B, M, 3) between points of `surface_points` as they are in an axis-parallel view.

    `direction` (B, 2) as in `move_points`; with the opposite sign the other way round.
    """
    across = vectors[..., :2] + vectors[..., 2:] * direction[:, None]
    return torch.cat([across, vectors[..., 2:]], -1)


def jacobian(points: Tensor, distance: Tensor) -> Tensor:
    """Derivative of each point's pixel by the pose delta at zero: (B, M, 2, 6)."""
    x, y, z = points.unbind(-1)
    rho = distance[:, None].expand_as(x)
    focal = OBJECT_SIZE * rho
    u, v = x / z * focal, y / z * focal  # pixels from the patch's centre
    near = rho / z
    deep = z - rho
    zero = torch.zeros_like(x)
    turn = focal / z * _DEGREE
    # A turn moves the point by w × (point − centre); its z part changes the pixel through u / z.
    du = [
        near,
        zero,
        u * near / OBJECT_SIZE,
        -u * y / z * _DEGREE,
        turn * deep + u * x / z * _DEGREE,
        -turn * y,
    ]
    dv = [
        zero,
        near,
        v * near / OBJECT_SIZE,
        -turn * deep - v * y / z * _DEGREE,
        v * x / z * _DEGREE,
        turn * x,
    ]
    return torch.stack([torch.stack(du, -1), torch.stack(dv, -1)], -2)


def precision(shape: Tensor) -> Tensor:
    """How well each direction of a displacement is known: (..., 2) → (..., 2, 2), determinant 1.

    Along an edge nothing fixes a displacement, across it everything does. The matrix is the
    exponential of [[a, b], [b, −a]] for the two numbers (a, b), bounded; (0, 0) gives the identity.
    """
    length = (shape.square().sum(-1) + 1e-6).sqrt()
    bounded = _SHARPEST * torch.tanh(length / _SHARPEST)
    even, odd = torch.cosh(bounded), torch.sinh(bounded) / length
    a, b = (odd[..., None] * shape).unbind(-1)
    rows = [torch.stack([even + a, b], -1), torch.stack([b, even - a], -1)]
    return torch.stack(rows, -2)


def solve_delta(
    displacement: Tensor,
    weight: Tensor,
    shape: Tensor,
    matrix: Tensor,
    damping: Tensor,
    limit: float = LONGEST,
) -> tuple[Tensor, Tensor]:
    """Pose delta (B, 6) whose first-order displacement fits best, and its information (B, 6, 6).

    The information is the inverse of the delta's covariance if a cell of full weight errs by one
    pixel; the damping does not count in it.

    `displacement` (B, M, 2) pixels, `weight` (B, M) ≥ 0, `shape` (B, M, 2) as `precision` takes it,
    `matrix` (B, M, 2, 6) from `jacobian`, `damping` (6,) a prior that the delta is small.
    Differentiable in all of them.
    """
    total = weight.sum(1)[:, None, None].clamp_min(1e-6)
    # Written out: thousands of products of 2 × 2 matrices would take longer than all the rest.
    known = (precision(shape) * weight[..., None, None])[..., None]  # (B, M, 2, 2, 1)
    across, down = matrix.unbind(-2)
    rows = [known[..., k, 0, :] * across + known[..., k, 1, :] * down for k in (0, 1)]
    weighted = torch.stack(rows, -2).flatten(1, 2)
    flat = matrix.flatten(1, 2)
    information = weighted.mT @ flat
    normal = information / total + torch.diag(damping)
    right = weighted.mT @ displacement.flatten(1)[..., None] / total
    delta: Tensor = torch.linalg.solve_ex(normal, right)[0][..., 0]
    return delta.clamp(-limit, limit), information
