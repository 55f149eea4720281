"""Lens distortion: where a real lens, OpenCV's or its fisheye, puts what a pinhole would see.

Never knows poses or meshes. Maps and points of arrays are OpenCV's own functions, points of tensors
are kornia's; nothing here writes a lens's formula out again.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import Any, Literal

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from ..typing import Float32, Float64, Mask

DistortionModel = Literal["opencv", "fisheye"]
# How many coefficients OpenCV's two models have.
COUNTS: dict[str, tuple[int, ...]] = {"opencv": (4, 5, 8, 12, 14), "fisheye": (4,)}
ORDER = "k1, k2, p1, p2[, k3[, k4, k5, k6[, s1, s2, s3, s4[, tau_x, tau_y]]]]"
LARGEST = 1e6  # no lens has such a coefficient; beyond it the polynomials overflow
# No lens folds within this share of the way to the nearest corner, nor puts that corner so many
# times as far out as a pinhole would: strong wide-angle lenses draw it inwards.
FOLDED, MOST_STRETCHED = 0.8, 2.0
_FAR = 1e6  # pixels: outside of every image, and exact in OpenCV's arithmetic
# A pinhole's picture of all that a lens shows: no rays farther off the axis, where it draws things
# out more than twice, and so many times the pixels at most, which bounds what a search costs.
WIDEST, LARGEST_SHARE = math.radians(65), 3.0
RINGS, DIRECTIONS = 96, 360  # of the rays that are tried for it
BEYOND = 1.1  # times the tangent of the farthest corner: a lens off its axis shows a little more


@dataclass(frozen=True)
class Lens:
    """A distortion that is not zero; `coefficients` in OpenCV's order.

    `opencv`: k1, k2, p1, p2, then k3, then k4, k5, k6 (rational), s1 … s4 (thin prism), tau_x,
    tau_y (tilted sensor). `fisheye`: k1 … k4 of the equidistant model (Kannala–Brandt).
    """

    model: DistortionModel
    coefficients: tuple[float, ...]

    @cached_property
    def reach(self) -> float:
        """Tangent of the angle to the axis up to which the lens shows each ray once.

        Farther out the polynomial turns back and would show the image's middle again. Infinite
        where it never does.
        """
        tangent, _, turns = _radii(self)
        return float(tangent[-1]) if turns else math.inf

    def project(self, points: Float64, matrix: Float64) -> Float64:
        """Pixels (N, 2) of points (N, 3) in the camera's frame, z > 0, for K (3, 3)."""
        import cv2

        points = np.ascontiguousarray(points, np.float64).reshape(-1, 1, 3)
        if not len(points):
            return np.zeros((0, 2))
        zero, lens = np.zeros(3), np.array(self.coefficients)
        if self.model == "fisheye":
            pixels, _ = cv2.fisheye.projectPoints(points, zero, zero, matrix, lens)
        else:
            pixels, _ = cv2.projectPoints(points, zero, zero, matrix, lens)
        pixels = pixels.reshape(-1, 2)
        pixels[:, 0] += skewed(pixels[:, 1], matrix)
        return np.asarray(pixels, np.float64)

    def shows(self, points: Float64) -> Mask:
        """Which of the points (N, 3) lie in front of the camera and within `reach`."""
        z = points[:, 2]
        aside = np.hypot(points[:, 0], points[:, 1])
        inside: Mask = (z > 0) & (aside < self.reach * z)
        return inside

    def distort(self, plane: Tensor) -> Tensor:
        """Points (..., 2) of the plane z = 1 as the lens moves them; differentiable (kornia)."""
        flat = plane.reshape(-1, 2)
        lens = flat.new_tensor(self.coefficients)
        if self.model == "fisheye":
            from kornia.geometry.camera import distort_points_kannala_brandt

            moved = distort_points_kannala_brandt(
                flat, torch.cat([lens.new_tensor([1.0, 1.0, 0.0, 0.0]), lens])
            )
        else:
            from kornia.geometry.calibration import distort_points

            eye = torch.eye(3, dtype=flat.dtype, device=flat.device)
            moved = distort_points(flat, eye, lens)
        found: Tensor = moved.reshape(plane.shape)
        return found

    def undistort(self, pixels: Float64, matrix: Float64) -> Float64:
        """Where a pinhole with K (3, 3) would have seen what the lens shows at pixels (N, 2)."""
        import cv2

        points = np.array(pixels, np.float64).reshape(-1, 1, 2)
        points[..., 0] -= skewed(points[..., 1], matrix)  # of P, not of K, OpenCV heeds the skew
        module = cv2.fisheye if self.model == "fisheye" else cv2
        ends = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 100, 1e-9)
        lens = np.array(self.coefficients)
        found = module.undistortPoints(points, matrix, lens, R=None, P=matrix, criteria=ends)
        return np.asarray(found, np.float64).reshape(-1, 2)

    def directions(self, pixels: Float64, matrix: Float64) -> Float64:
        """Unit vectors (N, 3) towards what the lens shows at pixels (N, 2), for K (3, 3).

        A fisheye's may point to the side and back, where no plane before the camera shows them.
        """
        pixels = np.array(pixels, np.float64).reshape(-1, 2)
        if self.model == "fisheye":
            # OpenCV takes every pixel farther out than 90 degrees would be for one at 90 degrees.
            y = (pixels[:, 1] - matrix[1, 2]) / matrix[1, 1]
            x = (pixels[:, 0] - skewed(pixels[:, 1], matrix) - matrix[0, 2]) / matrix[0, 0]
            radius = np.hypot(x, y)
            angle, shown = _shown_angles(self.coefficients)
            found = np.interp(radius, shown, angle)
            aside = np.sin(found) / np.maximum(radius, 1e-12)
            return np.column_stack([aside * x, aside * y, np.cos(found)])
        flat = self.undistort(pixels, matrix)
        rays = np.column_stack([flat, np.ones(len(flat))]) @ np.linalg.inv(matrix).T
        return np.asarray(rays / np.linalg.norm(rays, axis=1, keepdims=True))

    def patch_map(
        self, rotation: Float64, virtual: Float64, matrix: Float64, size: int
    ) -> tuple[Float32, Float32]:
        """Where each pixel of a virtual pinhole's picture, size × size, lies in the image.

        `rotation` (3, 3) turns the camera's frame to the virtual camera's, `virtual` and `matrix`
        are their intrinsics. Returns u and v (size, size); rays that the lens does not show lie far
        outside.
        """
        return self._rectify(rotation, virtual, matrix, size, size)

    def undistortion_maps(
        self, matrix: Float64, virtual: Float64, width: int, height: int
    ) -> tuple[Any, Any]:
        """OpenCV's fixed-point maps from a pinhole's image to the real one, kept for next time.

        `virtual` (3, 3) is that pinhole's matrix, `width` and `height` its image's. Pixels whose
        rays the lens does not show map to far outside.
        """
        entries = (tuple(float(value) for value in one.reshape(9)) for one in (matrix, virtual))
        return _kept_maps(self, *entries, width, height)

    def margins(self, matrix: Float64, width: int, height: int) -> tuple[int, int, int, int]:
        """Pixels that an image of K (3, 3) without the lens needs more to show all that this does.

        On the left, above, on the right and below; 0 where the lens pushes nothing out. Rays far
        from the axis are left out (`WIDEST`), and the farthest ones until the larger image has no
        more than `LARGEST_SHARE` times the pixels.
        """
        size = np.array([width, height])
        rings = self._shown_rings(matrix, width, height)
        flat = rings @ matrix[:2, :2].T + matrix[:2, 2]  # (rings, directions, 2)
        beyond = np.nan_to_num(np.concatenate([-0.5 - flat, flat - (size - 0.5)], -1)).max(1)
        # Half a pixel is nothing; what a ring needs its followers need, too.
        margins = np.rint(beyond.clip(min=0))
        needed = np.stack([margins[: k + 1].max(0) for k in range(len(margins))])
        pixels = (width + needed[:, 0] + needed[:, 2]) * (height + needed[:, 1] + needed[:, 3])
        fitting = int((pixels <= LARGEST_SHARE * width * height).sum())
        left, top, right, bottom = (int(margin) for margin in needed[max(fitting - 1, 0)])
        return left, top, right, bottom

    def _shown_rings(self, matrix: Float64, width: int, height: int) -> Float64:
        """Places (rings, directions, 2) of the plane z = 1 that the lens shows in an image.

        Rings around the axis from the inside out. A direction's first ring behind the image's edge
        is at the edge instead; others outside of the image are NaN.
        """
        low, high = np.full(2, -0.5), np.array([width, height]) - 0.5
        u, v = np.array([[u, v] for u in (low[0], high[0]) for v in (low[1], high[1])]).T
        y = (v - matrix[1, 2]) / matrix[1, 1]
        x = (u - matrix[0, 2] - matrix[0, 1] * y) / matrix[0, 0]
        tangents, shown, _ = _radii(self)
        corner = BEYOND * float(np.interp(np.hypot(x, y).max(), shown, tangents))
        farthest = min(corner, math.tan(WIDEST), 0.999 * self.reach)
        # A lens hardly turns things about its axis: the corners lie near these directions.
        angle = np.append(np.arange(DIRECTIONS) * (2 * math.pi / DIRECTIONS), np.arctan2(y, x))
        rays = np.ones((RINGS + 1, len(angle), 3))
        rays[..., :2] = np.linspace(0, farthest, RINGS + 1)[:, None, None] * np.stack(
            [np.cos(angle), np.sin(angle)], -1
        )
        seen = self.project(rays.reshape(-1, 3), matrix).reshape(*rays.shape[:2], 2)
        outside = np.maximum(low - seen, seen - high).max(-1, keepdims=True)  # negative inside
        plane = rays[..., :2]
        before, after = outside[:-1], outside[1:]
        leaving = (before <= 0) & (after > 0)
        share = before / np.where(leaving, before - after, 1.0)
        edges = np.where(leaving, plane[:-1] + share * (plane[1:] - plane[:-1]), math.nan)
        return np.asarray(np.where(after <= 0, plane[1:], edges), np.float64)

    def _rectify(
        self, rotation: Float64, virtual: Float64, matrix: Float64, width: int, height: int
    ) -> tuple[Float32, Float32]:
        """`patch_map` for a virtual picture of width × height."""
        import cv2

        lens, size, kind = np.array(self.coefficients), (width, height), cv2.CV_32FC1
        module = cv2.fisheye if self.model == "fisheye" else cv2
        u, v = module.initUndistortRectifyMap(matrix, lens, rotation, virtual, size, kind)
        if matrix[0, 1]:
            u = u + skewed(v, matrix).astype(np.float32)
        back = rotation.T @ np.linalg.inv(virtual)
        columns = back[:, 0, None] * np.arange(width, dtype=np.float64)
        rows = back[:, 1, None] * np.arange(height, dtype=np.float64) + back[:, 2, None]
        corners = [rows[:, i] + columns[:, j] for i in (0, -1) for j in (0, -1)]
        # z is linear and the tangent quasi-convex over the picture: its corners have the extremes.
        if not self.shows(np.array(corners)).all():
            rays = rows[:, :, None] + columns[:, None]
            shown = self.shows(rays.reshape(3, -1).T).reshape(height, width)
            u, v = np.where(shown, u, np.float32(-_FAR)), np.where(shown, v, np.float32(-_FAR))
        return u, v


def checked_lens(model: str, coefficients: tuple[float, ...]) -> None:
    """`InputError` unless there are as many coefficients as OpenCV knows, each of a lens."""
    if model not in COUNTS:
        known = " or ".join(repr(name) for name in COUNTS)
        raise InputError(f"Camera: the distortion model is {model!r}, must be {known}.")
    if len(coefficients) not in COUNTS[model]:
        what = "k1, k2, k3, k4" if model == "fisheye" else ORDER
        counts = " or ".join(str(count) for count in COUNTS[model])
        raise InputError(
            f"Camera: the {model} lens has {counts} coefficients ({what}), found "
            f"{len(coefficients)}."
        )
    if not all(abs(value) <= LARGEST for value in coefficients):
        raise InputError(
            f"Camera: no lens has distortion coefficients such as {max(coefficients, key=abs):.3g}."
        )


def checked_picture(lens: Lens, matrix: Float64, width: int, height: int) -> None:
    """`InputError` if a picture that the lens shows so cannot be, for K (3, 3).

    That is, if it folds well within the corner that is nearest to the principal point, or draws
    that corner out to more than `MOST_STRETCHED` times its distance. Calibrations that saw nothing
    in the corners often fold there, and are right everywhere else.
    """
    u, v = (np.array([-0.5, side - 0.5]) for side in (width, height))
    y = np.repeat((v - matrix[1, 2]) / matrix[1, 1], 2)
    x = (np.tile(u, 2) - matrix[0, 2] - matrix[0, 1] * y) / matrix[0, 0]
    corner = float(np.hypot(x, y).min())
    tangent, shown, turns = _radii(lens)
    advice = "check the calibration: the coefficients' order and model, fx, fy and the image size."
    if turns and shown[-1] < FOLDED * corner:
        pixels = shown[-1] * math.sqrt(matrix[0, 0] * matrix[1, 1])
        raise InputError(
            f"Camera: the distortion coefficients fold the picture {pixels:.0f} pixels from its "
            f"centre, well inside of it; {advice}"
        )
    without = float(np.interp(corner, shown, tangent))
    if shown[-1] > corner > MOST_STRETCHED * without:
        raise InputError(
            f"Camera: the distortion coefficients draw the picture's corners out to "
            f"{corner / without:.1f} times their distance from the centre; {advice}"
        )


@lru_cache(maxsize=16)
def _radii(lens: Lens) -> tuple[Float64, Float64, bool]:
    """Tangents (N,), where the lens shows them, as radii (N,) that grow; whether it then turns."""
    if lens.model == "fisheye":
        angle = np.linspace(0.0, math.pi / 2, 2001)[:-1]
        shown = angle * _polynomial(angle**2, lens.coefficients)
        tangent = np.tan(angle)
    else:
        tangent = np.linspace(0.0, 10.0, 10001)
        k = (*lens.coefficients, *(0.0,) * 4)
        square = tangent**2
        above = _polynomial(square, (k[0], k[1], k[4]))
        below = _polynomial(square, k[5:8] if len(lens.coefficients) >= 8 else ())
        shown = np.where(below > 0, tangent * above / np.where(below > 0, below, 1), -np.inf)
    turns = np.flatnonzero(shown[1:] <= shown[:-1])
    end = int(turns[0]) + 1 if len(turns) else len(tangent)
    return tangent[:end], shown[:end], bool(len(turns))


def _shown_angles(coefficients: tuple[float, ...]) -> tuple[Float64, Float64]:
    """Angles (N,) to a fisheye's axis, where it shows them, as radii (N,) that grow."""
    angle = np.linspace(0.0, math.pi, 20_001)
    shown = angle * _polynomial(angle**2, coefficients)
    turns = np.flatnonzero(shown[1:] <= shown[:-1])
    end = int(turns[0]) + 1 if len(turns) else len(angle)
    return angle[:end], shown[:end]


@lru_cache(maxsize=2)  # a 4K camera's take 50 MB
def _kept_maps(
    lens: Lens, entries: tuple[float, ...], virtual: tuple[float, ...], width: int, height: int
) -> tuple[Any, Any]:
    import cv2

    matrix, pinhole = (np.array(one).reshape(3, 3) for one in (entries, virtual))
    u, v = lens._rectify(np.eye(3), pinhole, matrix, width, height)
    fixed: tuple[Any, Any] = cv2.convertMaps(u, v, cv2.CV_16SC2)
    return fixed


def _polynomial(square: Float64, coefficients: tuple[float, ...]) -> Float64:
    """1 + c1·s + c2·s² + …"""
    powers = np.polynomial.polynomial.polyval(square, (1.0, *coefficients))
    return np.asarray(powers, np.float64)


def skewed(v: Any, matrix: Float64) -> Any:
    """What the skew adds to u, which OpenCV leaves out: s·y for the distorted y of pixels' v."""
    return matrix[0, 1] * (v - matrix[1, 2]) / matrix[1, 1]
