"""The look-at crop: the part of an image around an object as a virtual camera would see it.

Never renders and never knows a network. The virtual camera has the real camera's centre, its
optical axis goes through the object's centre, and its focal length makes the object's bounding
sphere `PATCH_SIZE / PADDING` pixels wide; in its frame every object stands at (0, 0, ‖t‖).

The axis-parallel crop, which others use, is a square cut out of the image: its camera is not turned
and the square's middle is the object's. An object away from the image's middle then looks turned
and slanted. It is here to be compared with (docs/experiments/training.md).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import Any, Literal

import torch
from kornia.geometry.transform import remap
from torch import Tensor

from .lens import Lens
from .pose import Pose

PATCH_SIZE = 128
PADDING = 1.4
# Width of the bounding sphere in the patch, pixels: b in the units of the actions.
OBJECT_SIZE = PATCH_SIZE / PADDING
FAR = -1e6  # pixels: outside of every image

Crop = Literal["look_at", "axis_parallel"]


@dataclass(frozen=True)
class View:
    """Virtual cameras that show objects in the middle of their pictures, one a pose.

    `rotation` (..., 3, 3) turns real-camera coordinates into the virtual camera's; `intrinsics`
    (..., 3, 3) are the patch's; `distance` (...) is the depth of the object's centre in metres:
    ‖t‖ in a look-at view.
    """

    rotation: Tensor
    intrinsics: Tensor
    distance: Tensor

    def __getitem__(self, index: Any) -> View:
        """Part of the batch, indexed as a tensor's leading axes are."""
        return View(self.rotation[index], self.intrinsics[index], self.distance[index])

    @property
    def axis(self) -> Tensor:
        """Where the optical axis meets the patch, pixels (..., 2) from its middle: 0 if look-at."""
        return self.intrinsics[..., :2, 2] - (PATCH_SIZE - 1) / 2

    def widened(self, size: int) -> View:
        """The same cameras with patches of size × size pixels: more around the object shows."""
        if size == PATCH_SIZE:  # every iteration's
            return self
        intrinsics = self.intrinsics.clone()
        intrinsics[..., :2, 2] += (size - PATCH_SIZE) / 2
        return View(self.rotation, intrinsics, self.distance)

    def to_virtual(self, pose: Pose) -> Pose:
        """A pose of the real camera in the virtual camera's frame."""
        turned = (self.rotation @ pose.translation[..., None])[..., 0]
        return Pose(self.rotation @ pose.rotation, turned)

    def to_real(self, pose: Pose) -> Pose:
        """A pose of the virtual camera in the real camera's frame."""
        back = self.rotation.mT
        return Pose(back @ pose.rotation, (back @ pose.translation[..., None])[..., 0])


def look_at(pose: Pose, sphere_diameter: Tensor) -> View:
    """The virtual cameras for centred poses (...) of objects of the given diameters (...), metres.

    The turn is the smallest one that takes t/‖t‖ to the optical axis (no roll). Differentiable for
    objects in front of the camera. docs/method.md.
    """
    distance = pose.translation.norm(dim=-1)
    x, y, z = (pose.translation / distance[..., None]).unbind(-1)
    # Rotation about (y, −x, 0) that takes (x, y, z) to (0, 0, 1), written out.
    scale = 1 / (1 + z)
    rows = [1 - x * x * scale, -x * y * scale, -x, -x * y * scale, 1 - y * y * scale, -y, x, y, z]
    rotation = torch.stack(rows, -1).reshape(*x.shape, 3, 3)
    focal = OBJECT_SIZE * distance / sphere_diameter
    zero, one = torch.zeros_like(focal), torch.ones_like(focal)
    middle = one * ((PATCH_SIZE - 1) / 2)
    entries = [focal, zero, middle, zero, focal, middle, zero, zero, one]
    intrinsics = torch.stack(entries, -1).reshape(*focal.shape, 3, 3)
    return View(rotation, intrinsics, distance)


def axis_parallel(pose: Pose, sphere_diameter: Tensor) -> View:
    """As `look_at`, but with cameras that are not turned: the object is beside their axes."""
    x, y, z = pose.translation.unbind(-1)
    focal = OBJECT_SIZE * z / sphere_diameter
    zero, one = torch.zeros_like(focal), torch.ones_like(focal)
    middle = (PATCH_SIZE - 1) / 2
    entries = [
        focal,
        zero,
        middle - focal * x / z,
        zero,
        focal,
        middle - focal * y / z,
        zero,
        zero,
        one,
    ]
    intrinsics = torch.stack(entries, -1).reshape(*focal.shape, 3, 3)
    rotation = torch.eye(3).to(intrinsics).expand_as(intrinsics)
    return View(rotation, intrinsics, z)


def view_of(pose: Pose, sphere_diameter: Tensor, crop: Crop = "look_at") -> View:
    """The views (...) of a kind of crop for centred poses (...) of objects of these diameters."""
    views = {"look_at": look_at, "axis_parallel": axis_parallel}
    return views[crop](pose, sphere_diameter)


def crop_homography(view: View, intrinsics: Tensor) -> Tensor:
    """Pixels of the image → pixels of the patch, H = K_v R_v K⁻¹: (..., 3, 3)."""
    homography: Tensor = view.intrinsics @ view.rotation @ torch.linalg.inv(intrinsics)
    return homography


def patch_to_image(view: View, intrinsics: Tensor) -> Tensor:
    """Pixels of the patch → pixels of the image, the inverse of `crop_homography`: (..., 3, 3)."""
    focal = view.intrinsics[..., 0, 0]
    x, y = view.intrinsics[..., 0, 2], view.intrinsics[..., 1, 2]
    zero, one = torch.zeros_like(focal), torch.ones_like(focal)
    entries = [1 / focal, zero, -x / focal, zero, 1 / focal, -y / focal, zero, zero, one]
    inverse = torch.stack(entries, -1).reshape(*focal.shape, 3, 3)
    back: Tensor = intrinsics @ view.rotation.mT @ inverse
    return back


def crop_patches(images: Tensor, view: View, intrinsics: Tensor) -> Tensor:
    """Patches (B, C, 128, 128) of float images (B, C, H, W) as the virtual cameras see them.

    `intrinsics` (B, 3, 3) are the images'. Outside of the image the patch is black. Gradients flow
    to the images and to the view. Images much finer than the patch alias: see `crop_patch`.
    """
    return _sample(images, patch_to_image(view, intrinsics))


def crop_patch(
    image: Tensor,
    view: View,
    intrinsics: Tensor,
    lens: Lens | None = None,
    size: int = PATCH_SIZE,
) -> Tensor:
    """One anti-aliased float patch (C, 128, 128) in [0, 1] of a uint8 or float image (C, H, W).

    Only the window that the patch sees is touched; if it is finer than the patch it is averaged
    over blocks of whole pixels first. `view` and `intrinsics` are unbatched. With a `lens` the
    patch shows what a pinhole would have seen: the image itself need not be undistorted.
    """
    back = patch_to_image(view, intrinsics)
    finer = float(intrinsics[0, 0] / view.intrinsics[0, 0])  # image pixels a patch pixel
    factor = max(1, min(int(1.2 * finer), *image.shape[-2:]))
    pixels = None if lens is None else patch_pixels(view, intrinsics, lens, size)
    seen = _extent(back, size) if pixels is None else [plane.aminmax() for plane in pixels]
    window, (left, top) = _window(image, seen, factor)
    scale = 1.0 if window.is_floating_point() else 1 / 255
    window = window.to(torch.float32)
    if factor > 1:
        # Sums of slices: ten times faster here than torch's pooling.
        window = reduce(torch.add, [window[..., k::factor, :] for k in range(factor)])
        window = reduce(torch.add, [window[..., k::factor] for k in range(factor)])
    window = (window * (scale / factor**2))[None]
    # Half-pixel rule: the first block's centre is (factor − 1) / 2 pixels into the window.
    offset = back.new_tensor([left + (factor - 1) / 2, top + (factor - 1) / 2])
    if pixels is not None:
        u, v = ((plane - start) / factor for plane, start in zip(pixels, offset, strict=True))
        patch: Tensor = remap(window, u[None].float(), v[None].float(), align_corners=True)
        return patch[0]
    moved = back.clone()
    moved[:2] = (back[:2] - offset[:, None] * back[2]) / factor
    return _sample(window, moved[None], size)[0]


def patch_pixels(
    view: View, intrinsics: Tensor, lens: Lens | None = None, size: int = PATCH_SIZE
) -> tuple[Tensor, Tensor]:
    """Where each pixel of an unbatched view's patch lies in the image: u and v (128, 128), float64.

    Rays that the lens does not show, and those behind the camera, lie far outside.
    """
    if lens is not None:
        turn, virtual, matrix = (
            one.double().numpy() for one in (view.rotation, view.intrinsics, intrinsics)
        )
        u, v = lens.patch_map(turn, virtual, matrix, size)
        return torch.from_numpy(u).double(), torch.from_numpy(v).double()
    x, y, z = _back(patch_to_image(view, intrinsics)[None], size)
    if float(z.min()) <= 0:
        x, z = torch.where(z > 0, x, FAR), torch.where(z > 0, z, 1.0)
    return (x / z)[0], (y / z)[0]


def _sample(images: Tensor, back: Tensor, size: int = PATCH_SIZE) -> Tensor:
    """Images (B, C, H, W) at the places that homographies (B, 3, 3) send patch pixels to."""
    x, y, z = _back(back, size)
    u, v = (x / z).to(images.dtype), (y / z).to(images.dtype)
    patches: Tensor = remap(images, u, v, align_corners=True)
    return patches


def _back(back: Tensor, size: int) -> tuple[Tensor, ...]:
    """The image's homogeneous pixels (B, 128, 128), three of them, for all pixels of patches."""
    line = torch.arange(size, dtype=back.dtype, device=back.device)
    # Each patch pixel (x, y, 1) on its way back to the image: a row, a column and a constant.
    rows = back[:, :, 1, None] * line + back[:, :, 2, None]  # (B, 3, 128)
    columns = back[:, :, 0, None] * line
    return (rows[..., None] + columns[:, :, None]).unbind(1)  # (B, 128, 128) each


def _extent(back: Tensor, size: int) -> list[tuple[float, float]]:
    """Lowest and highest u and v of the image that a patch sees; all of it behind the camera."""
    edge = float(size)
    seen = [[a * x + b * y + c for x in (-1.0, edge) for y in (-1.0, edge)] for a, b, c in
            back.tolist()]  # fmt: skip
    if min(seen[2]) <= 0:
        return [(-math.inf, math.inf)] * 2
    places = [[x / z for x, z in zip(line, seen[2], strict=True)] for line in seen[:2]]
    return [(min(line), max(line)) for line in places]


def _window(
    image: Tensor, seen: Sequence[tuple[Any, Any]], factor: int
) -> tuple[Tensor, tuple[int, int]]:
    """The part of the image between the lowest and highest u and v, and its corner (left, top).

    In whole blocks of `factor` pixels where the image is large enough.
    """
    height, width = image.shape[-2:]
    left, right = _span(*seen[0], width, factor)
    top, bottom = _span(*seen[1], height, factor)
    return image[..., top:bottom, left:right], (left, top)


def _span(low: Any, high: Any, size: int, factor: int) -> tuple[int, int]:
    """First pixel and end of the whole blocks between `low` and `high` within `size` pixels.

    A block more on either side, since bilinear sampling reaches beyond the outermost places; and
    two at least, since kornia counts from the first pixel to the last.
    """
    low, high = (min(max(float(end), -1.0), float(size)) for end in (low, high))
    start = min(max(math.floor(low) - factor, 0), max(size - 2 * factor, 0))
    end = min(max(math.ceil(high) + factor + 1, start + 2 * factor), size)
    return start, start + _whole(end - start, factor)


def _whole(length: int, factor: int) -> int:
    return length // factor * factor
