"""Rotations as matrices and rotation vectors: exponential, logarithm, projection onto SO(3).

Never knows translations, cameras or units other than radians.
"""

from __future__ import annotations

import torch
from kornia.geometry.conversions import quaternion_to_rotation_matrix
from torch import Tensor


def hat(vector: Tensor) -> Tensor:
    """Cross-product matrix of each vector: (..., 3) → (..., 3, 3)."""
    x, y, z = vector.unbind(-1)
    zero = torch.zeros_like(x)
    rows = [zero, -z, y, z, zero, -x, -y, x, zero]
    return torch.stack(rows, -1).reshape(*vector.shape[:-1], 3, 3)


def exp_so3(vector: Tensor) -> Tensor:
    """Rotation matrix of each rotation vector (radians): (..., 3) → (..., 3, 3).

    Rodrigues' formula; differentiable everywhere, the zero vector included.
    """
    square = (vector * vector).sum(-1)[..., None, None]
    small = square < 1e-8
    # The square root has no gradient at zero, so the branch not taken must still be finite.
    angle = torch.where(small, torch.ones_like(square), square).sqrt()
    sine = torch.where(small, 1 - square / 6, angle.sin() / angle)
    cosine = torch.where(small, 0.5 - square / 24, (1 - angle.cos()) / (angle * angle))
    matrix = hat(vector)
    identity = torch.eye(3, dtype=vector.dtype, device=vector.device)
    return identity + sine * matrix + cosine * (matrix @ matrix)


def log_so3(rotation: Tensor) -> Tensor:
    """Rotation vector (radians, length at most π) of each matrix: (..., 3, 3) → (..., 3).

    Goes through the quaternion with the largest component first, which stays accurate at zero and
    at half turns. Differentiable except at half turns.
    """
    quaternion = _quaternion(rotation)
    real, imaginary = quaternion[..., :1], quaternion[..., 1:]
    sign = torch.where(real < 0, -1.0, 1.0).to(rotation.dtype)
    real, imaginary = real * sign, imaginary * sign
    square = (imaginary * imaginary).sum(-1, keepdim=True)
    small = square < 1e-12
    length = torch.where(small, torch.ones_like(square), square).sqrt()
    factor = torch.where(
        small, 2 / real.clamp_min(0.5) - 0 * square, 2 * torch.atan2(length, real) / length
    )
    return imaginary * factor


def nearest_rotation(matrix: Tensor) -> Tensor:
    """The rotation closest to each matrix in the Frobenius norm: (..., 3, 3) → (..., 3, 3)."""
    left, _, right = torch.linalg.svd(matrix)
    determinant = torch.linalg.det(left @ right)
    scale = torch.ones_like(matrix[..., 0])
    scale[..., 2] = torch.where(determinant < 0, -1.0, 1.0).to(matrix.dtype)
    nearest: Tensor = (left * scale[..., None, :]) @ right
    return nearest


def rotation_angle(rotation: Tensor) -> Tensor:
    """Angle of each rotation in radians: (..., 3, 3) → (...)."""
    angle: Tensor = log_so3(rotation).norm(dim=-1)
    return angle


def random_rotations(count: int, generator: torch.Generator | None = None) -> Tensor:
    """Uniformly random rotations, float64, on the generator's device: (count, 3, 3)."""
    device = None if generator is None else generator.device
    quaternion = torch.randn(count, 4, dtype=torch.float64, generator=generator, device=device)
    return from_quaternion(torch.nn.functional.normalize(quaternion, dim=-1))


def from_quaternion(quaternion: Tensor) -> Tensor:
    """Rotations of unit quaternions (w, x, y, z): (..., 4) → (..., 3, 3)."""
    rotation: Tensor = quaternion_to_rotation_matrix(quaternion)
    return rotation


def to_quaternion(rotation: Tensor) -> Tensor:
    """Unit quaternions (w, x, y, z), w not negative, of rotations: (..., 3, 3) → (..., 4)."""
    quaternion = _quaternion(rotation)
    return torch.where(quaternion[..., :1] < 0, -quaternion, quaternion)


def _quaternion(rotation: Tensor) -> Tensor:
    """Unit quaternion (w, x, y, z) of each matrix, computed from its largest component."""
    m = rotation
    trace = m[..., 0, 0] + m[..., 1, 1] + m[..., 2, 2]
    diagonal = torch.stack([trace, m[..., 0, 0], m[..., 1, 1], m[..., 2, 2]], -1)
    # Row k is 4·q_k·(w, x, y, z).
    wx, wy, wz = (
        m[..., 2, 1] - m[..., 1, 2],
        m[..., 0, 2] - m[..., 2, 0],
        m[..., 1, 0] - m[..., 0, 1],
    )
    xy, xz, yz = (
        m[..., 1, 0] + m[..., 0, 1],
        m[..., 0, 2] + m[..., 2, 0],
        m[..., 2, 1] + m[..., 1, 2],
    )
    ww, xx = 1 + trace, 1 + 2 * m[..., 0, 0] - trace
    yy, zz = 1 + 2 * m[..., 1, 1] - trace, 1 + 2 * m[..., 2, 2] - trace
    rows = torch.stack(
        [
            torch.stack([ww, wx, wy, wz], -1),
            torch.stack([wx, xx, xy, xz], -1),
            torch.stack([wy, xy, yy, yz], -1),
            torch.stack([wz, xz, yz, zz], -1),
        ],
        -2,
    )
    best = diagonal.argmax(-1)[..., None, None].expand(*m.shape[:-2], 1, 4)
    return torch.nn.functional.normalize(rows.gather(-2, best)[..., 0, :], dim=-1)
