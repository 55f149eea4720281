"""The camera: pinhole intrinsics, image size and, for real lenses, the distortion.

Never knows poses or meshes. Pixel (0, 0) is the centre of the top-left pixel, so an image of width
w reaches from −0.5 to w − 0.5; this is the half-pixel rule that `resize` and `crop` obey.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
import torch
from kornia.geometry.camera import project_points, unproject_points
from numpy.typing import NDArray
from torch import Tensor

from ..errors import InputError
from ..typing import Numbers
from .lens import DistortionModel, Lens, checked_lens, checked_picture
from .numbers import floating, vectors

LARGEST = 100_000  # pixels a side
RESAMPLED = (np.uint8, np.uint16, np.float32, np.float64)  # pixels that OpenCV interpolates
Picture = TypeVar("Picture", Tensor, NDArray[Any])


@dataclass(frozen=True)
class Camera:
    """Intrinsics in pixels: u = fx·x/z + skew·y/z + cx, v = fy·y/z + cy for width × height.

    `distortion` holds OpenCV's coefficients in its order (4, 5, 8, 12 or 14 of them; the 4 of its
    fisheye with `distortion_model="fisheye"`), or None; any list or array of them will do. With a
    lens, x/z and y/z are what it makes of them. `InputError` where a number cannot be right.

    >>> Camera(600, 600, 319.5, 239.5, 640, 480, [-0.1, 0.01, 0, 0]).distortion
    (-0.1, 0.01, 0.0, 0.0)
    """

    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: tuple[float, ...] | None = None
    distortion_model: DistortionModel = "opencv"
    skew: float = 0.0

    def __post_init__(self) -> None:
        for name in ("fx", "fy", "cx", "cy", "skew"):
            object.__setattr__(self, name, _number(getattr(self, name), name))
        for name in ("width", "height"):
            object.__setattr__(self, name, _whole(getattr(self, name), name))
        object.__setattr__(self, "distortion", _coefficients(self.distortion))
        numbers = [self.fx, self.fy, self.cx, self.cy, self.skew, *(self.distortion or ())]
        if not all(math.isfinite(number) for number in numbers):
            raise InputError("Camera: every intrinsic must be a finite number.")
        if self.fx <= 0 or self.fy <= 0:
            raise InputError(f"Camera: fx and fy must be positive, found {self.fx}, {self.fy}.")
        if not (1 <= self.width <= LARGEST and 1 <= self.height <= LARGEST):
            raise InputError(f"Camera: size {self.width}×{self.height} is not an image size.")
        if self.distortion is not None:
            checked_lens(self.distortion_model, self.distortion)
        elif self.distortion_model != "opencv":
            raise InputError(f"Camera: the {self.distortion_model} lens needs its coefficients.")

    @staticmethod
    def load(path: str | Path) -> Camera:
        """The camera of a file: our JSON, ROS camera_info (YAML, JSON), OpenCV YAML or XML.

        RealSense's and Kalibr's names are understood too (`camera_files`). A key that is not is
        an `InputError` that names it: a lens left out without a word is a wrong pose.
        """
        from .camera_files import read_camera_file

        return read_camera_file(Path(path))

    def save(self, path: str | Path) -> None:
        """Write a camera.json that `load`, and `--camera` on the command line, read back exactly.

        >>> camera = Camera.from_matrix([[600, 0, 320], [0, 610, 240], [0, 0, 1]], 640, 480)
        >>> camera.save("camera.json")
        >>> Camera.load("camera.json") == camera
        True
        """
        from .camera_files import write_camera_file

        write_camera_file(Path(path), self)

    @staticmethod
    def from_matrix(
        matrix: Any,
        width: int,
        height: int,
        distortion: Any = None,
        distortion_model: DistortionModel = "opencv",
    ) -> Camera:
        """From K (3, 3) and the distortion as OpenCV's and ROS' calibrations give them.

        Lists and arrays of any float type and shape: K (3, 3) or its nine numbers, distortion
        (N,), (1, N) or (N, 1). `InputError` for anything that is no such matrix, and for a lens
        that folds the picture well inside of it (`checked_picture`).

        >>> Camera.from_matrix([[600, 0, 320], [0, 610, 240], [0, 0, 1]], 640, 480).fy
        610.0
        """
        k = _array(matrix, "the intrinsic matrix")
        if k.shape not in ((3, 3), (9,)):
            raise InputError(f"Camera: the intrinsic matrix must be 3×3, found shape {k.shape}.")
        k = k.reshape(3, 3)
        if k[1, 0] or not np.array_equal(k[2], [0.0, 0.0, 1.0]):
            raise InputError(
                "Camera: an intrinsic matrix has the rows (fx, skew, cx), (0, fy, cy), (0, 0, 1), "
                f"found {k.tolist()}."
            )
        camera = Camera(
            k[0, 0], k[1, 1], k[0, 2], k[1, 2], width, height,
            distortion, distortion_model, k[0, 1],
        )  # fmt: skip
        return with_possible_picture(camera)

    @staticmethod
    def from_fov(degrees: float, width: int, height: int) -> Camera:
        """A guess where nothing is known: the field of view along the image's longer side.

        Square pixels, the axis through the middle, no distortion. A phone's main camera has about
        65 to 75 degrees in photos and a few less in videos.

        >>> round(Camera.from_fov(90, 640, 480).fx)
        320
        """
        degrees = _number(degrees, "the field of view")
        width, height = _whole(width, "width"), _whole(height, "height")
        if not 1 <= degrees <= 170:
            raise InputError(
                f"Camera: the field of view is {degrees} degrees; a pinhole has 1 to 170."
            )
        focal = 0.5 * max(width, height) / math.tan(math.radians(degrees) / 2)
        return Camera(focal, focal, (width - 1) / 2, (height - 1) / 2, width, height)

    @cached_property
    def lens(self) -> Lens | None:
        """The distortion; None if there is none."""
        if self.distortion is None:
            return None
        if self.distortion_model == "opencv" and not any(self.distortion):
            return None
        return Lens(self.distortion_model, self.distortion)

    @property
    def pinhole(self) -> Camera:
        """The same camera without its lens."""
        return replace(self, distortion=None, distortion_model="opencv")

    @cached_property
    def full_pinhole(self) -> Camera:
        """The pinhole camera that sees all that the lens shows, as far as a sensible image can.

        `pinhole` with whole pixels more on each side where the lens draws the picture inwards: up
        to 65 degrees off the axis and three times the pixels.

        >>> wide = Camera(1000, 1000, 639.5, 359.5, 1280, 720, [-0.3, 0.09, 0, 0]).full_pinhole
        >>> wide.fx, wide.width > 1280, wide.cx - 639.5 == (wide.width - 1280) / 2
        (1000.0, True, True)
        """
        if self.lens is None:
            return self.pinhole
        left, top, right, bottom = self.lens.margins(self.matrix.numpy(), self.width, self.height)
        width, height = self.width + left + right, self.height + top + bottom
        return self.pinhole.crop(-left, -top, width, height)

    @property
    def matrix(self) -> Tensor:
        """The intrinsic matrix K, float64 (3, 3)."""
        rows = [[self.fx, self.skew, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]]
        return torch.tensor(rows, dtype=torch.float64)

    def project(self, points: Numbers) -> Tensor:
        """Pixels of points in the camera's frame, through the lens: (..., 3) metres → (..., 2).

        Points on the camera's plane (z = 0) have no pixel and give NaN. Whole numbers, arrays and
        lists count as float64; `InputError` for what are no points.

        >>> import torch
        >>> Camera(600, 600, 320, 240, 640, 480).project(torch.tensor([0.1, 0.0, 0.5]))
        tensor([440., 240.])
        """
        points = vectors(points, 3, "Camera.project", "points")
        flat = points.reshape(-1, 3)
        plane = flat[:, :2] / flat[:, 2:]
        if self.lens is not None:
            plane = self.lens.distort(plane)
        # kornia leaves the skew out: a shear of the plane before it is the same.
        x, y = plane.unbind(-1)
        sheared = torch.stack([x + self.skew / self.fx * y, y, torch.ones_like(x)], -1)
        pixels: Tensor = project_points(sheared, self.matrix.to(points).expand(len(flat), 3, 3))
        pixels = pixels.where(flat[:, 2:] != 0, torch.nan)
        return pixels.reshape(*points.shape[:-1], 2)

    def unproject(self, pixels: Numbers, depth: Numbers | float = 1.0) -> Tensor:
        """Points in the camera's frame behind pixels (..., 2) at a depth z: (..., 3) metres.

        `depth` (...) is a number or broadcasts against the pixels; whole pixels, arrays and lists
        count as float64. `InputError` for what are no pixels, and of a camera with a lens: undo
        that first (`undistort`).

        >>> import torch
        >>> Camera(600, 600, 320, 240, 640, 480).unproject(torch.tensor([440.0, 240.0]), 0.5)
        tensor([0.1000, 0.0000, 0.5000])
        """
        if self.lens is not None:
            raise InputError("Camera.unproject: undo the lens first, with Camera.undistort.")
        pixels = vectors(pixels, 2, "Camera.unproject", "pixels")
        flat = pixels.reshape(-1, 2)
        z = floating(depth, "Camera.unproject", "depth").to(pixels)
        try:
            z = z.expand(pixels.shape[:-1]).reshape(-1, 1)
        except RuntimeError:
            raise InputError(
                f"Camera.unproject: depths of shape {tuple(z.shape)} do not fit to pixels of shape "
                f"{tuple(pixels.shape)}; give one a pixel, or a single one."
            ) from None
        matrix = self.matrix.to(pixels).expand(len(flat), 3, 3)
        points: Tensor = unproject_points(flat, z, matrix)
        x, y, forward = points.unbind(-1)
        points = torch.stack([x - self.skew / self.fx * y, y, forward], -1)
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
            skew=self.skew * x,
            width=width,
            height=height,
        )

    def crop(self, x: int, y: int, width: int, height: int) -> Camera:
        """The camera of the window whose top-left pixel is (x, y)."""
        return replace(self, cx=self.cx - x, cy=self.cy - y, width=width, height=height)

    def undistort(self, image: Picture, full: bool = False) -> tuple[Picture, Camera]:
        """Undo the lens: the image as this camera would see it without distortion.

        A tensor or array (..., C, H, W), (H, W, C) or (H, W), uint8, uint16 or floating point,
        comes back as one of the same shape and type (the same one if there is no distortion), with
        the pinhole camera. What a wide lens shows near the border lies outside of that image;
        `full` gives the larger one of `full_pinhole`. The map is kept for the next image of this
        camera. `InputError` for what is no image of the camera's size.
        """
        given = image.detach().cpu().numpy() if isinstance(image, Tensor) else image
        pixels = self._channels_last(given)
        lens = self.lens
        if lens is None:
            return image, self.pinhole
        import cv2

        seen = self.full_pinhole if full else self.pinhole
        width, height = seen.width, seen.height
        maps = lens.undistortion_maps(self.matrix.numpy(), seen.matrix.numpy(), width, height)
        flat = np.empty((len(pixels), height, width, pixels.shape[-1]), pixels.dtype)
        for one, undone in zip(pixels, flat, strict=True):
            undone[:] = cv2.remap(np.ascontiguousarray(one), *maps, cv2.INTER_LINEAR).reshape(
                undone.shape
            )
        if given.shape[-2:] == (self.height, self.width):
            flat = np.moveaxis(flat, -1, 1).reshape(*given.shape[:-2], height, width)
        else:
            flat = flat.reshape(height, width, *given.shape[2:])
        found = np.ascontiguousarray(flat)
        return (torch.from_numpy(found) if isinstance(image, Tensor) else found), seen

    def _channels_last(self, image: Any) -> NDArray[Any]:
        """Images of this camera as (B, H, W, C)."""
        if not isinstance(image, np.ndarray) or image.dtype not in RESAMPLED:
            found = image.dtype if isinstance(image, np.ndarray) else type(image).__name__
            raise InputError(
                "Camera.undistort: an image is an array or tensor of uint8, uint16 or floating "
                f"point numbers, found {found}."
            )
        shape, size = image.shape, (self.height, self.width)
        if shape[-2:] == size:
            channels = shape[-3] if len(shape) > 2 else 1
            return np.moveaxis(image.reshape(math.prod(shape[:-3]), channels, *size), 1, -1)
        if len(shape) == 3 and shape[:2] == size:
            return image[None]
        raise InputError(
            f"Camera.undistort: the camera is {self.width}×{self.height}, so that an image is "
            f"(..., C, {self.height}, {self.width}) or ({self.height}, {self.width}, C); found "
            f"{shape}."
        )


def project(points: Tensor, intrinsics: Tensor) -> Tensor:
    """Pixels of points in the camera's frame: (..., N, 3) or (..., 3), K (..., 3, 3) → (..., 2).

    The fast twin of `Camera.project`, for one camera or a batch of intrinsics. Points on the
    camera's plane (z = 0) give infinities.
    """
    focal = torch.stack([intrinsics[..., 0, 0], intrinsics[..., 1, 1]], -1)
    centre, skew = intrinsics[..., :2, 2], intrinsics[..., 0, 1, None]
    if points.dim() > focal.dim():
        focal, centre, skew = focal[..., None, :], centre[..., None, :], skew[..., None, :]
    plane = points[..., :2] / points[..., 2:]
    sheared = torch.cat([skew * plane[..., 1:], torch.zeros_like(plane[..., 1:])], -1)
    return plane * focal + sheared + centre


def _array(values: Any, what: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    if isinstance(values, Tensor):
        values = values.detach().cpu().numpy()
    try:
        return np.asarray(values, np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"Camera: {what} must be numbers, found {values!r:.80}.") from None


def _number(value: Any, name: str) -> float:
    number = _array(value, name)
    if number.size != 1:
        raise InputError(f"Camera: {name} must be one number, found shape {number.shape}.")
    return float(number.reshape(()))


def _whole(value: Any, name: str) -> int:
    number = _number(value, name)
    if not number.is_integer():
        raise InputError(f"Camera: {name} must be a whole number, found {value!r}.")
    return int(number)


def _coefficients(values: Any) -> tuple[float, ...] | None:
    """The distortion as a tuple; OpenCV hands it over as (1, N) or (N, 1), ROS perhaps empty."""
    if values is None:
        return None
    array = _array(values, "distortion")
    if array.ndim > 2 or max(array.shape, default=1) != array.size:
        raise InputError(f"Camera: distortion must be a list of numbers, found {array.shape}.")
    return tuple(float(value) for value in array.reshape(-1)) or None


def with_possible_picture(camera: Camera) -> Camera:
    """The camera itself; `InputError` if its lens cannot show such a picture."""
    if camera.lens is not None:
        checked_picture(camera.lens, camera.matrix.numpy(), camera.width, camera.height)
    return camera
