"""The camera: pinhole intrinsics, image size and, for real lenses, the distortion to be undone.

Never knows poses or meshes. Pixel (0, 0) is the centre of the top-left pixel, so an image of width
w reaches from −0.5 to w − 0.5; this is the half-pixel rule that `resize` and `crop` obey.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import torch
from kornia.geometry.camera import project_points, unproject_points
from torch import Tensor

from ..errors import InputError


@dataclass(frozen=True)
class Camera:
    """Intrinsics in pixels: u = fx·x/z + cx, v = fy·y/z + cy for an image of width × height.

    `distortion` holds OpenCV's (k1, k2, p1, p2, k3) or None. Everything but `undistort` works on
    the pinhole part: undistort the image first and go on with the camera that it returns.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        numbers = [self.fx, self.fy, self.cx, self.cy, *(self.distortion or ())]
        if not all(math.isfinite(number) for number in numbers):
            raise InputError("Camera: every intrinsic must be a finite number.")
        if self.fx <= 0 or self.fy <= 0:
            raise InputError(f"Camera: fx and fy must be positive, found {self.fx}, {self.fy}.")
        if self.width < 1 or self.height < 1:
            raise InputError(f"Camera: size {self.width}×{self.height} is not an image size.")
        if self.distortion is not None and len(self.distortion) != 5:
            raise InputError(
                "Camera: distortion must be k1, k2, p1, p2, k3; "
                f"found {len(self.distortion)} values."
            )

    @property
    def matrix(self) -> Tensor:
        """The intrinsic matrix K, float64 (3, 3)."""
        rows = [[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]]
        return torch.tensor(rows, dtype=torch.float64)

    def project(self, points: Tensor) -> Tensor:
        """Pinhole projection of points in the camera's frame: (..., 3) metres → (..., 2) pixels.

        Points on the camera's plane (z = 0) have no pixel and give NaN.

        >>> import torch
        >>> Camera(600, 600, 320, 240, 640, 480).project(torch.tensor([0.1, 0.0, 0.5]))
        tensor([440., 240.])
        """
        flat = points.reshape(-1, 3)
        pixels: Tensor = project_points(flat, self.matrix.to(points).expand(len(flat), 3, 3))
        pixels = pixels.where(flat[:, 2:] != 0, torch.nan)
        return pixels.reshape(*points.shape[:-1], 2)

    def unproject(self, pixels: Tensor, depth: Tensor | float = 1.0) -> Tensor:
        """Points in the camera's frame behind pixels (..., 2) at a depth z: (..., 3) metres.

        `depth` (...) is a number or broadcasts against the pixels.

        >>> import torch
        >>> Camera(600, 600, 320, 240, 640, 480).unproject(torch.tensor([440.0, 240.0]), 0.5)
        tensor([0.1000, 0.0000, 0.5000])
        """
        flat = pixels.reshape(-1, 2)
        z = torch.as_tensor(depth).to(pixels).expand(pixels.shape[:-1]).reshape(-1, 1)
        matrix = self.matrix.to(pixels).expand(len(flat), 3, 3)
        points: Tensor = unproject_points(flat, z, matrix)
        return points.reshape(*pixels.shape[:-1], 3)

    def resize(self, width: int, height: int) -> Camera:
        """The camera of the same picture resampled to width × height (half-pixel rule)."""
        x, y = width / self.width, height / self.height
        return replace(
            self,
            fx=self.fx * x,
            fy=self.fy * y,
            cx=(self.cx + 0.5) * x - 0.5,
            cy=(self.cy + 0.5) * y - 0.5,
            width=width,
            height=height,
        )

    def crop(self, x: int, y: int, width: int, height: int) -> Camera:
        """The camera of the window whose top-left pixel is (x, y)."""
        return replace(self, cx=self.cx - x, cy=self.cy - y, width=width, height=height)

    def undistort(self, image: Tensor) -> tuple[Tensor, Camera]:
        """Undo the lens: (..., C, H, W) image as this camera would see it without distortion.

        Returns the image (the same one if there is no distortion) and the pinhole camera.
        """
        if self.distortion is None or not any(self.distortion):
            return image, replace(self, distortion=None)
        from kornia.geometry.calibration import undistort_image  # here: rarely needed

        batch = image.reshape(-1, *image.shape[-3:])
        floating = batch if batch.is_floating_point() else batch.float()
        matrix = self.matrix.to(floating)[None].expand(len(batch), 3, 3)
        coefficients = floating.new_tensor(self.distortion)[None].expand(len(batch), 5)
        undone = undistort_image(floating, matrix, coefficients)
        if not batch.is_floating_point():
            undone = undone.round().clamp(0, 255)
        return undone.to(batch.dtype).reshape(image.shape), replace(self, distortion=None)


def project(points: Tensor, intrinsics: Tensor) -> Tensor:
    """Pixels of points in the camera's frame: (..., N, 3) or (..., 3), K (..., 3, 3) → (..., 2).

    The fast twin of `Camera.project`, for one camera or a batch of intrinsics. Points on the
    camera's plane (z = 0) give infinities.
    """
    focal = torch.stack([intrinsics[..., 0, 0], intrinsics[..., 1, 1]], -1)
    centre = intrinsics[..., :2, 2]
    if points.dim() > focal.dim():
        focal, centre = focal[..., None, :], centre[..., None, :]
    return points[..., :2] / points[..., 2:] * focal + centre
