"""What is known about where an object may be: a box, a mask, a distance, a pose nearby.

Never sees an image and never scores anything.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from ...config import DetectorConfig, RegionConfig
from ...errors import InputError
from ...geometry.camera import Camera, project
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose

DEFAULT = RegionConfig()
SAME_INSTANCE = DetectorConfig().same_instance
SMALLEST_BOX = 4  # pixels a side
# Pixels, and of the image's shorter side: no distance makes a search look for narrower objects.
# They are hardly found, and the image would be enlarged beyond all measure.
SMALLEST_WIDTH, SMALLEST_SHARE = 16, 1 / 60
NEAR = 0.05  # of the distance: a box that reaches nearer to the camera's plane would have no end


@dataclass(frozen=True)
class SearchRegion:
    """Where to look for one object; what is None is not known.

    `box` is (x, y, width, height) in pixels around what is visible of the object; `mask` (H, W)
    bool its visible pixels; `distance` (nearest, farthest) metres from the camera to the object's
    centre; `near` a pose (mesh file's frame) that is roughly right; `taken` those of other
    instances, where this one is not.
    """

    box: tuple[float, float, float, float] | None = None
    mask: NDArray[np.bool_] | None = None
    distance: tuple[float, float] | None = None
    near: Pose | None = None
    taken: tuple[Pose, ...] = ()

    @staticmethod
    def checked(
        camera: Camera,
        box: Any = None,
        mask: Any = None,
        distance: Any = None,
        near: Pose | None = None,
    ) -> SearchRegion:
        """From numbers that a user gave; `InputError` says what is wrong with them."""
        return SearchRegion(
            None if box is None else _box(box, camera),
            None if mask is None else _mask(mask, camera),
            None if distance is None else _distance(distance),
            near,
        )

    def check_common(self, config: RegionConfig) -> None:
        """`InputError` where box and mask, as people draw them, show two places."""
        if self.box is None or self.mask is None:
            return
        rows, columns = np.nonzero(self.mask)
        x, y, width, height = self.box
        inside = (x <= columns + 0.5) & (columns - 0.5 <= x + width)
        inside &= (y <= rows + 0.5) & (rows - 0.5 <= y + height)
        if inside.sum() < config.least_covered * min(len(rows), width * height):
            raise InputError(
                f"box and mask contradict each other: {100 * inside.mean():.0f} % of the mask is "
                f"inside of the box; the mask reaches from {columns.min()} {rows.min()} to "
                f"{columns.max()} {rows.max()}. Leave one of them out."
            )

    def undistorted(self, camera: Camera) -> SearchRegion:
        """The same region in the image without its lens, that of `Camera.full_pinhole`."""
        bounds = self.bounds
        if camera.lens is None or bounds is None:
            return self
        mask = self.mask
        if mask is None:
            x, y, width, height = bounds
            mask = np.zeros((camera.height, camera.width), np.bool_)
            mask[max(0, round(y)) : round(y + height), max(0, round(x)) : round(x + width)] = True
        flat = camera.undistort(mask.astype(np.uint8), full=True)[0] > 0
        if not flat.any():
            raise InputError("box or mask: nothing of it is left once the lens is undone.")
        region = replace(self, box=None, mask=flat)
        return region if self.mask is not None else replace(self, box=region.bounds)

    @property
    def empty(self) -> bool:
        """Whether nothing is known."""
        known = (self.box, self.mask, self.distance, self.near)
        return not self.taken and all(value is None for value in known)

    @cached_property
    def bounds(self) -> tuple[float, float, float, float] | None:
        """The box, or the one around the mask: (x, y, width, height)."""
        if self.box is not None or self.mask is None:
            return self.box
        rows, columns = np.nonzero(self.mask)
        left, top = float(columns.min()) - 0.5, float(rows.min()) - 0.5
        return left, top, float(columns.max()) + 0.5 - left, float(rows.max()) + 0.5 - top

    def window(
        self, mesh: Mesh, camera: Camera, width: float, config: RegionConfig = DEFAULT
    ) -> tuple[int, int, int, int] | None:
        """The part of the image to look at (left, top, right, bottom); None for all of it.

        `width` is the largest one of the object that is tried, pixels.
        """
        bounds = self.bounds
        if bounds is None and self.near is not None:
            pixel = _pixel(mesh, self.near, camera)
            u, v = pixel.tolist()
            longest = _width(mesh, self.near, camera) / float(_cosine(pixel, camera)) ** 2
            reach = config.near_shift * longest
            bounds = u - reach, v - reach, 2 * reach, 2 * reach
        if bounds is None:
            return None
        x, y, wide, high = bounds
        margin = config.margin * width
        left, top = max(0, round(x - margin)), max(0, round(y - margin))
        right = min(camera.width, round(x + wide + margin))
        bottom = min(camera.height, round(y + high + margin))
        return (left, top, right, bottom) if left < right and top < bottom else None

    def widths(
        self,
        mesh: Mesh,
        camera: Camera,
        shares: tuple[float, float],
        config: RegionConfig = DEFAULT,
    ) -> tuple[float, float]:
        """Smallest and largest width of the object's sphere in pixels that are to be tried.

        As it is seen where it may be (`widening`). `shares` of the image's shorter side are their
        limits where neither a distance nor a box nor a pose says more. `InputError` if the object
        is too small to be found at any distance that is given.
        """
        side, bounds = min(camera.width, camera.height), self.bounds
        low, high = _smallest_width(camera), math.inf
        if self.distance is not None:
            wider = widening(self._places(mesh, camera), camera)
            low, high = _widths_between(self.distance, mesh, camera, wider)
        elif bounds is None and self.near is None:
            low, high = shares[0] * side, shares[1] * side
        if bounds is not None:
            longest, (least, most) = max(bounds[2], bounds[3]), config.box_ratio
            low, high = max(low, least * longest), min(high, most * longest)
            low, high = min(low, longest * most), max(high, longest)
        if self.near is not None:
            wider = widening(_pixel(mesh, self.near, camera), camera)
            size, ratio = _width(mesh, self.near, camera) * float(wider), config.near_ratio
            low, high = max(low, size / ratio), min(high, size * ratio)
            if low > high:
                low, high = size / ratio, size * ratio
        return low, max(low, high)

    def allows(
        self,
        mesh: Mesh,
        camera: Camera,
        pixels: Tensor,
        sizes: Tensor,
        boxes: Tensor,
        config: RegionConfig = DEFAULT,
        same_instance: float = SAME_INSTANCE,
    ) -> Tensor:
        """Which candidates (N) may be: centres (N, 2), sphere widths (N) and template boxes (N, 4).

        Widths are those on the camera's axis, as far away. Boxes are edges from the centre in
        widths of the sphere, as seen along the ray through it.
        """
        allowed = torch.ones(len(pixels), dtype=torch.bool)
        bounds, rays = self.bounds, functional.normalize(camera.unproject(pixels), dim=1)
        if bounds is not None:
            edges = _edges(rays, boxes * sizes[:, None], camera)
            union, covered = overlap(edges, bounds)
            part = (covered >= config.part_covered) & (union >= config.part_overlap)
            allowed &= (union >= config.box_overlap) | part
        if self.near is not None:
            width = _width(mesh, self.near, camera)
            allowed &= _aside(rays, self.near, mesh, camera) < config.near_shift * width
        for other in self.taken:
            aside = _aside(rays, other, mesh, camera)
            allowed &= aside >= same_instance * sizes.clamp(min=_width(mesh, other, camera))
        return allowed

    def _places(self, mesh: Mesh, camera: Camera) -> Tensor:
        """Pixels (N, 2) where the object may be; of the whole image its middle and its edges'."""
        bounds, right, bottom = self.bounds, camera.width - 1, camera.height - 1
        if bounds is not None:
            x, y, wide, high = bounds
            return torch.tensor([[x + wide / 2, y + high / 2]], dtype=torch.float64)
        if self.near is not None:
            return _pixel(mesh, self.near, camera)[None]
        u, v = _middle(camera)
        places = [(u, v), (0, v), (right, v), (u, 0), (u, bottom)]
        return torch.tensor(places, dtype=torch.float64)


def check_distance(distance: tuple[float, float], mesh: Mesh, camera: Camera) -> None:
    """`InputError` where an object is too small to be found in the image's middle so far away.

    There it is seen narrowest.
    """
    middle = torch.tensor([_middle(camera)], dtype=torch.float64)
    _widths_between(distance, mesh, camera, widening(middle, camera))


def _middle(camera: Camera) -> tuple[float, float]:
    """The image's pixel that is nearest to the camera's axis."""
    u = min(max(camera.cx, 0.0), camera.width - 1.0)
    v = min(max(camera.cy, 0.0), camera.height - 1.0)
    return u, v


def _widths_between(
    distance: tuple[float, float], mesh: Mesh, camera: Camera, wider: Tensor
) -> tuple[float, float]:
    """Widths of the object's sphere, pixels, at the farthest and at the nearest distance.

    `wider` (N,) is the `widening` where it may be.
    """
    near, far = distance
    largest = width_at(near, mesh, camera) * float(wider.max())
    least = _smallest_width(camera)
    if largest < least:
        raise InputError(
            f"distance {near:g} {far:g}: even at {near:g} m the object would be under {least:g} "
            f"pixels wide in an image of {camera.width}×{camera.height}, too small to be found; "
            "check the metres and the mesh's unit."
        )
    return max(width_at(far, mesh, camera) * float(wider.min()), least), largest


def _smallest_width(camera: Camera) -> float:
    """Width of the narrowest objects that are looked for, pixels."""
    return max(SMALLEST_WIDTH, SMALLEST_SHARE * min(camera.width, camera.height))


def _width(mesh: Mesh, pose: Pose, camera: Camera) -> float:
    return width_at(float(mesh.inner(pose).translation.norm()), mesh, camera)


def width_at(distance: float, mesh: Mesh, camera: Camera) -> float:
    """Width of the object's sphere at a distance on the camera's axis, pixels."""
    return 0.5 * (camera.fx + camera.fy) * mesh.sphere_diameter / distance


def widening(pixels: Tensor, camera: Camera) -> Tensor:
    """By how much (...) things at pixels (..., 2) are seen wider than on the axis, as far away.

    A pinhole image draws them out by 1 / cos of the angle to the axis, and away from the axis by
    1 / cos²: this is between both.
    """
    return _cosine(pixels, camera) ** -1.5


def _cosine(pixels: Tensor, camera: Camera) -> Tensor:
    """Of the angle (...) between the rays of pixels (..., 2) and the camera's axis."""
    return functional.normalize(camera.unproject(pixels), dim=-1)[..., 2]


def _aside(rays: Tensor, pose: Pose, mesh: Mesh, camera: Camera) -> Tensor:
    """How far rays (N, 3) pass a pose's centre, pixels (N,) as they are on the camera's axis."""
    centre = functional.normalize(mesh.inner(pose).translation.to(rays), dim=0)
    along = rays @ centre
    aside = (1 - along.square()).clamp(min=0).sqrt() / along.clamp(min=NEAR)  # tangent of the angle
    return 0.5 * (camera.fx + camera.fy) * aside


def _edges(rays: Tensor, boxes: Tensor, camera: Camera) -> Tensor:
    """Edges (N, 4) in the image of boxes (N, 4) that look-at views along rays (N, 3) show.

    Those are edges from the middle, in pixels as they are on the camera's axis.
    """
    left, top, right, bottom = (boxes / (0.5 * (camera.fx + camera.fy))).T.contiguous()
    # Corners (4, N) at depth 1, turned as `look_at` turns, written out: there may be many.
    a, b = torch.stack([left, right, left, right]), torch.stack([top, top, bottom, bottom])
    x, y, z = rays.T.contiguous()
    along = x * a + y * b
    share = 1 - along / (1 + z)
    points = torch.stack([a + x * share, b + y * share, (z - along).clamp(min=NEAR)])
    u, v = project(points.permute(1, 2, 0), camera.matrix.to(points)).unbind(-1)
    return torch.stack([u.amin(0), v.amin(0), u.amax(0), v.amax(0)], 1)


def _pixel(mesh: Mesh, pose: Pose, camera: Camera) -> Tensor:
    return camera.project(mesh.inner(pose.to(torch.float64)).translation).to(torch.float32)


def overlap(edges: Tensor, bounds: tuple[float, float, float, float]) -> tuple[Tensor, Tensor]:
    """Of boxes (N, 4), given by edges, with one (x, y, width, height): their common part.

    As shares of the union, and of the one box.
    """
    x, y, width, height = bounds
    across = (edges[:, 2].clamp(max=x + width) - edges[:, 0].clamp(min=x)).clamp(min=0)
    down = (edges[:, 3].clamp(max=y + height) - edges[:, 1].clamp(min=y)).clamp(min=0)
    common = across * down
    area = (edges[:, 2] - edges[:, 0]) * (edges[:, 3] - edges[:, 1])
    return common / (area + width * height - common).clamp(min=1e-6), common / (width * height)


def _numbers(values: Any, count: int, what: str) -> tuple[float, ...]:
    try:
        numbers = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        raise InputError(f"{what}: {count} numbers are needed, found {values!r}.") from None
    if len(numbers) != count or not np.isfinite(numbers).all():
        raise InputError(f"{what}: {count} finite numbers are needed, found {values!r}.")
    return numbers


def _box(values: Any, camera: Camera) -> tuple[float, float, float, float]:
    x, y, width, height = _numbers(values, 4, "box")
    inside = x < camera.width and y < camera.height and x + width > 0 and y + height > 0
    if min(width, height) < SMALLEST_BOX or not inside:
        raise InputError(
            f"box {x:g} {y:g} {width:g} {height:g}: left, top, width and height in pixels, at "
            f"least {SMALLEST_BOX} wide and high and inside the image of "
            f"{camera.width}×{camera.height}, are needed."
        )
    return x, y, width, height


def _mask(mask: Any, camera: Camera) -> NDArray[np.bool_]:
    array = mask.detach().cpu().numpy() if isinstance(mask, Tensor) else np.asarray(mask)
    if array.shape != (camera.height, camera.width):
        raise InputError(
            f"mask: shape {tuple(array.shape)}, but the image is {camera.height} rows of "
            f"{camera.width} pixels; give a mask of the image's size with one channel."
        )
    found: NDArray[np.bool_] = array > 0
    if int(found.sum()) < 16:
        raise InputError("mask: fewer than 16 pixels are set; non-zero pixels mark the object.")
    return found


def _distance(values: Any) -> tuple[float, float]:
    near, far = _numbers(values, 2, "distance")
    if not 0 < near <= far:
        raise InputError(
            f"distance {near:g} {far:g}: two positive numbers of metres, the nearer first, are "
            "needed."
        )
    return near, far
