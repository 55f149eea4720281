"""What an object looked like in a frame where its pose was known, put onto its renderings.

Never decides whether a pose is right. A mesh's colours are those of a scan under other light; the
frame shows the real ones, and what is painted with them lies where the start pose put it.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch
from kornia.geometry.transform import remap
from torch import Tensor
from torch.nn import functional

from ..geometry.crop import View, crop_patch, look_at
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..rendering.renderer import GBuffer, Renderer
from ..rendering.shading import shade_plain
from .frame import Frame

SAME_SURFACE = 0.03  # diameters; a point farther behind what the frame shows was hidden in it
FACING = (0.15, 0.5)  # cosines; steeper surface was seen too foreshortened, flatter one well
SOFT = 5  # pixels over which seen and unseen surface go over into each other: no false edges
ENOUGH = 30.0  # pixels; with fewer in sight there is nothing to fit the other ones' brightness to
GAIN = (0.3, 3.0)
# Something before the object, if its colours are so much farther from the mesh's than they are in
# the middle, and by at least so much.
STRANGE = (2.5, 0.12)


@dataclass(frozen=True)
class Appearance:
    """A patch of the frame with the surface that it shows; all float32, look-at view of `pose`.

    `pose` (unbatched, centred object → virtual camera) and `intrinsics` (3, 3) are that view's;
    `patch` (3, 128, 128) is RGB in [0, 1], `depth` (1, 128, 128) metres; `usable` (1, 128, 128) is
    0 where the surface is not seen, 1 where it is seen well.
    """

    pose: Pose
    intrinsics: Tensor
    patch: Tensor
    depth: Tensor
    usable: Tensor
    diameter: float

    @staticmethod
    def of(frame: Frame, mesh: Mesh, pose: Pose, renderer: Renderer) -> Appearance:
        """What the object with this pose (mesh file's frame) looks like in the frame."""
        centred = mesh.inner(pose.to(torch.float64))
        batch = Pose(centred.rotation[None], centred.translation[None])
        view = look_at(batch, torch.tensor([mesh.sphere_diameter], dtype=torch.float64))
        alone = View(view.rotation[0], view.intrinsics[0], view.distance[0])
        patch = crop_patch(frame.pixels, alone, frame.camera.matrix())
        virtual = view.to_virtual(batch)
        buffer = renderer.render([mesh], virtual, view.intrinsics)
        # Pixels at the outline hold some of the background.
        inside = -functional.max_pool2d(-buffer.mask, 3, 1, 1)
        steepest, flattest = FACING
        facing = ((-buffer.normal[:, 2:] - steepest) / (flattest - steepest)).clamp(0, 1)
        own = inside * ~_strange(patch, shade_plain(buffer)[0], inside[0, 0] > 0)
        usable = own * facing * functional.avg_pool2d(own, SOFT, 1, SOFT // 2)
        return Appearance(
            virtual[0].to(torch.float32),
            view.intrinsics[0].float(),
            patch,
            buffer.depth[0],
            usable[0],
            mesh.sphere_diameter,
        )

    def paint(self, rendering: Tensor, buffer: GBuffer, intrinsics: Tensor, pose: Pose) -> Tensor:
        """A rendering (3, 128, 128) with the frame's colours wherever the frame shows the surface.

        `buffer` (batch of one) and `rendering` are seen with `intrinsics` (3, 3) at `pose`
        (unbatched, centred object → virtual camera). What the frame does not show keeps the
        rendering's colours, as bright as those it shows.
        """
        depth, mask = buffer.depth[0], buffer.mask[0]
        u, v, far = self._places(depth[0], intrinsics.to(depth), pose.to(torch.float32))
        maps = torch.cat([self.patch, self.depth, self.usable])[None]
        found = remap(maps, u[None], v[None], align_corners=True)[0]
        colours, seen, usable = found[:3], found[3], found[4]
        near = (seen - far).abs() < SAME_SURFACE * self.diameter
        share = usable * near * mask[0]
        if share.sum() < ENOUGH:
            return rendering
        brightness = (rendering * share).sum((1, 2)).clamp_min(1e-3)
        gain = ((colours * share).sum((1, 2)) / brightness).clamp(*GAIN)
        rest = (rendering * gain[:, None, None]).clamp(0, 1)
        painted: Tensor = (rest + share * (colours - rest)) * mask
        return painted

    def _places(
        self, depth: Tensor, intrinsics: Tensor, pose: Pose
    ) -> tuple[Tensor, Tensor, Tensor]:
        """Patch pixels (x, y) of the frame where each pixel's surface lies, and its depth there."""
        line = torch.arange(depth.shape[-1], dtype=depth.dtype)
        x = (line - intrinsics[0, 2]) / intrinsics[0, 0] * depth
        y = (line[:, None] - intrinsics[1, 2]) / intrinsics[1, 1] * depth
        points = torch.stack([x, y, depth]).flatten(1) - pose.translation[:, None]
        there = self.pose.rotation @ (pose.rotation.mT @ points) + self.pose.translation[:, None]
        x, y, far = there.reshape(3, *depth.shape)
        deep = far.clamp_min(1e-6)
        u = x / deep * self.intrinsics[0, 0] + self.intrinsics[0, 2]
        v = y / deep * self.intrinsics[1, 1] + self.intrinsics[1, 2]
        return u, v, far


def _strange(patch: Tensor, rendering: Tensor, inside: Tensor) -> Tensor:
    """Where (128, 128) a patch (3, 128, 128) is unlike the rendering as nowhere else on the object.

    By colour, whatever the light's is: the rendering is made as bright as the patch, by the median
    in each channel, and differences are averaged over a few pixels.
    """
    if not inside.any():
        return torch.zeros_like(inside)
    ratio = (patch + 0.02) / (rendering + 0.02)
    gain = ratio[:, inside].median(1).values.clamp(*GAIN)
    difference = (patch - (rendering * gain[:, None, None]).clamp(0, 1)).abs().mean(0)
    smooth = functional.avg_pool2d(difference[None] * inside, 7, 1, 3)[0]
    smooth = smooth / functional.avg_pool2d(inside[None].float(), 7, 1, 3)[0].clamp_min(0.02)
    factor, least = STRANGE
    return smooth > max(least, factor * float(smooth[inside].median()))
