"""What a policy sees: the crop of a frame and the rendering of the current pose, as tensors.

Never predicts anything and never knows a network.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields

import torch
from torch import Tensor

from .frame import Frame
from .geometry.crop import PATCH_SIZE, Crop, View, crop_patch, view_of
from .geometry.mesh import Mesh
from .geometry.pose import Pose
from .rendering.renderer import GBuffer, Renderer
from .rendering.shading import shade_plain

# What networks see around a rendering, and the middle of what they see: a dark background would be
# an outline of its own. The networks are trained with it.
GREY = 0.45


@dataclass(frozen=True)
class Observation:
    """A batch of patches, all float32, in the look-at view of the current poses.

    `image` (B, 3, 128, 128) and `rendering` (B, 3, 128, 128) are RGB in [0, 1]; `depth`
    (B, 1, 128, 128) is the rendering's depth behind the object's centre in sphere diameters
    (negative in front of it, 0 outside the object); `mask` (B, 1, 128, 128) is 1 on the object;
    `distance` (B,) is ‖t‖ in sphere diameters.
    """

    image: Tensor
    rendering: Tensor
    depth: Tensor
    mask: Tensor
    distance: Tensor

    def __len__(self) -> int:
        return len(self.image)

    def to(self, device: torch.device) -> Observation:
        """The same patches on another device."""
        return Observation(*(getattr(self, field.name).to(device) for field in fields(self)))

    def channels(self, use_depth: bool = True) -> Tensor:
        """The paper's input: (B, 8, 128, 128), or (B, 7, 128, 128) without depth."""
        parts = [self.image, self.rendering, self.depth, self.mask]
        if not use_depth:
            parts.pop(2)
        return torch.cat(parts, 1)


def mirrored(seen: Observation) -> Observation:
    """The same patches with right and left exchanged, as in a mirror beside the object."""
    image, rendering = seen.image.flip(3), seen.rendering.flip(3)
    return Observation(image, rendering, seen.depth.flip(3), seen.mask.flip(3), seen.distance)


def rotated(seen: Observation, quarters: int) -> Observation:
    """The same patches turned by quarters, counterclockwise, as if the camera rolled the other way.

    A pixel (x, y) from the patch's middle comes to (y, −x) with each.
    """
    image, rendering, depth, mask = (
        torch.rot90(part, quarters, (2, 3))
        for part in (seen.image, seen.rendering, seen.depth, seen.mask)
    )
    return Observation(image, rendering, depth, mask, seen.distance)


def observe(
    frames: Sequence[Frame],
    meshes: Sequence[Mesh],
    pose: Pose,
    sphere_diameter: Tensor,
    renderer: Renderer,
    crop: Crop = "look_at",
    size: int = PATCH_SIZE,
) -> Observation:
    """Crop the frames and render the meshes at centred poses (B), one observation each.

    `sphere_diameter` (B,) are those, metres, that fill the crops: a smaller one than the mesh's
    shows the middle of the object enlarged. Crops of another `size` show more around it, no larger.
    """
    view = view_of(pose, sphere_diameter, crop).widened(size)
    crops = [
        crop_patch(frame.pixels, view[row], frame.intrinsics, frame.camera.lens, size)
        for row, frame in enumerate(frames)
    ]
    gbuffer = renderer.render(meshes, view.to_virtual(pose), view.intrinsics, size)
    return assemble(torch.stack(crops), gbuffer, view, sphere_diameter)


def observe_shared(
    frame: Frame, gbuffer: GBuffer, view: View, sphere_diameter: Tensor
) -> Observation:
    """Crops (B) of one frame beside one rendering (1) that is the same in every view."""
    count = len(sphere_diameter)
    matrix, lens = frame.intrinsics, frame.camera.lens
    crops = [crop_patch(frame.pixels, view[row], matrix, lens) for row in range(count)]
    parts = (gbuffer.albedo, gbuffer.normal, gbuffer.depth, gbuffer.mask)
    shared = GBuffer(*(part.expand(count, -1, -1, -1) for part in parts))
    return assemble(torch.stack(crops), shared, view, sphere_diameter)


def assemble(patches: Tensor, gbuffer: GBuffer, view: View, sphere_diameter: Tensor) -> Observation:
    """Put together what the policy sees.

    `patches` (B, 3, 128, 128) are the crops of the frame in [0, 1], `gbuffer` the renderings in the
    same `view`; `sphere_diameter` (B,) in metres.
    """
    distance = view.distance.to(gbuffer.depth)
    diameter = sphere_diameter.to(gbuffer.depth)
    depth = (gbuffer.depth - distance[:, None, None, None]) / diameter[:, None, None, None]
    rendering = shade_plain(gbuffer).clamp(0, 1)
    return Observation(patches, rendering, depth * gbuffer.mask, gbuffer.mask, distance / diameter)
