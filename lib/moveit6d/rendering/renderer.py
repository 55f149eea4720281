"""What every renderer offers: from meshes, poses and intrinsics to a G-buffer without any light.

Never shades; light is tensor arithmetic on the G-buffer (`shading`).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
import torch
from torch import Tensor

from ..errors import InputError
from ..geometry.crop import PATCH_SIZE
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose


@dataclass(frozen=True)
class GBuffer:
    """What each pixel of square patches sees, float32. Outside of the object everything is 0."""

    albedo: Tensor  # (B, 3, H, W) in [0, 1]
    normal: Tensor  # (B, 3, H, W) unit, camera frame, turned towards the camera
    depth: Tensor  # (B, 1, H, W) metres along z
    mask: Tensor  # (B, 1, H, W) 0 or 1


class Renderer(Protocol):
    """A back end. Implementations differ in speed and needs, not in what they return."""

    @property
    def name(self) -> str:
        """The name that `make_renderer` knows it by."""

    def render(
        self, meshes: Sequence[Mesh], poses: Pose, intrinsics: Tensor, size: int = PATCH_SIZE
    ) -> GBuffer:
        """One patch of size × size for each mesh.

        Poses (B) take the meshes' centred frames to the camera; intrinsics are (B, 3, 3), and
        pixel (0, 0) is the centre of the top-left pixel.
        """


def check_batch(meshes: Sequence[Mesh], poses: Pose, intrinsics: Tensor, size: int) -> None:
    """`InputError` unless meshes, poses and intrinsics belong to one batch."""
    count = len(meshes)
    if poses.batch_shape != (count,) or intrinsics.shape != (count, 3, 3):
        raise InputError(
            f"render: {count} meshes need {count} poses and intrinsics ({count}, 3, 3), found "
            f"{tuple(poses.batch_shape)} poses and intrinsics {tuple(intrinsics.shape)}."
        )
    if size < 1:
        raise InputError(f"render: the patch size is {size}, must be positive.")


def gather(
    render_one: Callable[..., tuple[Any, Any, Any]],
    meshes: Sequence[Mesh],
    poses: Pose,
    intrinsics: Tensor,
    size: int,
) -> GBuffer:
    """A G-buffer on the intrinsics' device from a function that renders one patch as arrays.

    It is called with mesh, rotation, translation, intrinsics and size, and returns albedo
    (H, W, 3) uint8, normal (H, W, 3) and depth (H, W) float32.
    """
    rotation, translation, matrices = (
        values.detach().to("cpu", torch.float64).numpy()
        for values in (poses.rotation, poses.translation, intrinsics)
    )
    albedo = np.empty((len(meshes), size, size, 3), np.uint8)
    normal = np.empty((len(meshes), size, size, 3), np.float32)
    depth = np.empty((len(meshes), 1, size, size), np.float32)
    for b, mesh in enumerate(meshes):
        albedo[b], normal[b], depth[b, 0] = render_one(
            mesh, rotation[b], translation[b], matrices[b], size
        )
    distance = torch.from_numpy(depth).to(intrinsics.device)
    return GBuffer(
        albedo=_channels_first(albedo).to(intrinsics.device).float().div_(255),
        normal=_channels_first(normal).to(intrinsics.device),
        depth=distance,
        mask=(distance > 0).float(),
    )


def _channels_first(images: Any) -> Tensor:
    return torch.from_numpy(images).permute(0, 3, 1, 2).contiguous()
