"""Region-based refinement of a pose: Gauss–Newton on correspondence lines, with a prior.

Never remembers anything between two calls and never knows a network. SRT3D, Stoiber et al., IJCV
2022; the prior is ours: contours do not fix everything, and who proposed the pose knew more.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import torch
from torch import Tensor

from ..config import ContourConfig
from ..geometry.crop import OBJECT_SIZE, PATCH_SIZE, View, crop_patch, look_at, patch_pixels
from ..geometry.lens import Lens
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..rendering.renderer import Renderer
from ..typing import Float32, Float64, Mask, RGBImage
from .correspondence_lines import contour_distances
from .extraction import Contour, find_contour
from .histograms import ColourHistograms, estimate_histograms

DEFAULT = ContourConfig()


@dataclass(frozen=True)
class ContourRefinement:
    """A pose after the refinement, how well it fits the image, and the colours there.

    `pose` is unbatched, centred and float64; `agreement` in [0, 1] is the share of the contour
    where colours change sharply and in the right place; `histograms` are the image's own at that
    pose, None if there is too little to see.
    """

    pose: Pose
    agreement: float
    histograms: ColourHistograms | None


@dataclass(frozen=True)
class _VirtualPose:
    """A pose in the virtual camera of the given pose, and how far it is from that.

    `moved` (6,) is the delta so far; steps this small add up. Plain arrays: torch would spend
    longer on a dozen numbers than all the rest takes.
    """

    rotation: Float64  # (3, 3)
    centre: Float64  # (3,)
    moved: Float64  # (6,)

    def step(self, delta: Float64, focal: float) -> _VirtualPose:
        """The pose after an update by a delta (6,), as `PoseAction.apply_centred` has it."""
        import cv2

        turn = cv2.Rodrigues(np.deg2rad(delta[3:]))[0]
        aside = np.append(delta[:2] * self.centre[2] / focal, 0.0)
        centre = (self.centre + aside) * OBJECT_SIZE / (OBJECT_SIZE + delta[2])
        return _VirtualPose(turn @ self.rotation, centre, self.moved + delta)

    def pose(self) -> Pose:
        """The same as tensors."""
        return Pose(torch.from_numpy(self.rotation), torch.from_numpy(self.centre))


@dataclass(frozen=True)
class _Patch:
    """The patch that the virtual camera of the given pose sees; all is computed in it."""

    mesh: Mesh
    renderer: Renderer
    view: View
    image: RGBImage  # (H, W, 3)
    seen: Mask  # (H, W), False outside of the image

    def virtual(self, pose: Pose) -> _VirtualPose:
        """A centred pose of the real camera, from which nothing has moved yet."""
        turned = self.view.to_virtual(pose)
        return _VirtualPose(turned.rotation.numpy(), turned.translation.numpy(), np.zeros(6))

    def render(self, current: _VirtualPose) -> tuple[Mask, Float32]:
        """Mask and depth (H, W)."""
        buffer = self.renderer.render([self.mesh], current.pose()[None], self.view.intrinsics[None])
        return buffer.mask[0, 0].numpy() > 0, buffer.depth[0, 0].numpy()


def refine_contour(
    image: Tensor,
    intrinsics: Tensor,
    mesh: Mesh,
    pose: Pose,
    renderer: Renderer,
    histograms: ColourHistograms | None = None,
    config: ContourConfig = DEFAULT,
    lens: Lens | None = None,
    moves: bool = True,
) -> ContourRefinement:
    """Fit the contour of a mesh near a centred pose to an image (3, H, W) taken through `lens`.

    `histograms` are what the object and its surroundings looked like before; without them those of
    this very image at the given pose must do. Without `moves` the pose stays, and only how well
    it fits is found out.
    """
    patch = _crop(image, intrinsics, mesh, pose, renderer, lens)
    current = patch.virtual(pose)
    mask, depth = patch.render(current)
    known = histograms or estimate_histograms(patch.image, mask, patch.seen, config)
    if known is None:
        return ContourRefinement(pose, 0.0, None)
    odds, agreement = known.log_odds(patch.image, patch.seen, config), 0.0
    every = config.scales if moves else (config.scales[-1][-1:],)
    for turn, scales in enumerate(every):
        if turn:
            mask, depth = patch.render(current)
        contour = find_contour(mask, config.lines, config.normal_blur)
        if contour is None or len(contour.points) < config.min_lines:
            return ContourRefinement(pose, 0.0, None)
        focal = float(patch.view.intrinsics[0, 0])
        moved, agreement = _fit(odds, contour, depth, current, focal, scales, config, patch.seen)
        current = moved if moves else current
    if not np.abs(current.moved).max() <= config.max_delta:  # nor numbers that are not finite
        return ContourRefinement(pose, 0.0, None)
    found = patch.view.to_real(current.pose()) if moves else pose
    after = estimate_histograms(patch.image, mask, patch.seen, config)
    return ContourRefinement(found, agreement, after)


def histograms_at(
    image: Tensor,
    intrinsics: Tensor,
    mesh: Mesh,
    pose: Pose,
    renderer: Renderer,
    config: ContourConfig = DEFAULT,
    lens: Lens | None = None,
) -> ColourHistograms | None:
    """The colours that an image (3, H, W) shows of a mesh at a centred pose, and beside it.

    None if there is too little to see.
    """
    patch = _crop(image, intrinsics, mesh, pose, renderer, lens)
    mask, _ = patch.render(patch.virtual(pose))
    return estimate_histograms(patch.image, mask, patch.seen, config)


def _crop(
    image: Tensor,
    intrinsics: Tensor,
    mesh: Mesh,
    pose: Pose,
    renderer: Renderer,
    lens: Lens | None,
) -> _Patch:
    """Cut the patch out of the image."""
    view = look_at(pose, torch.tensor(mesh.sphere_diameter, dtype=torch.float64))
    patch = crop_patch(image, view, intrinsics, lens)
    picture = (patch * 255).round().clamp(0, 255).to(torch.uint8).permute(1, 2, 0).numpy()
    return _Patch(
        mesh,
        renderer,
        view,
        np.ascontiguousarray(picture),
        _seen(*patch_pixels(view, intrinsics, lens), *image.shape[-2:]),
    )


def _seen(u: Tensor, v: Tensor, height: int, width: int) -> Mask:
    """Which pixels of the patch (H, W) lie in the image, at u and v there."""
    across, down = (u >= -0.5) & (u <= width - 0.5), (v >= -0.5) & (v <= height - 0.5)
    seen: Mask = (across & down).numpy()
    return seen


def _fit(
    odds: Float32,
    contour: Contour,
    depth: Float32,
    current: _VirtualPose,
    focal: float,
    scales: tuple[int, ...],
    config: ContourConfig,
    seen: Mask,
) -> tuple[_VirtualPose, float]:
    """The pose after one step a scale, with the contour of one rendering; and the agreement."""
    middle = (PATCH_SIZE - 1) / 2
    z = depth[tuple(contour.inside.T)].astype(np.float64)
    points = np.column_stack([(contour.points - middle) / focal * z[:, None], z])
    on_object = (points - current.centre) @ current.rotation
    agreement = 0.0
    for scale in scales:
        points = on_object @ current.rotation.T + current.centre
        pixels = points[:, :2] / points[:, 2:] * focal + middle
        mean, variance = contour_distances(odds, pixels, contour.normals, scale, config)
        slope = (jacobian(points, current.centre, focal) * contour.normals[:, :, None]).sum(1)
        weight = contour.lengths * config.lines / len(mean) / (config.correlation * variance)
        weight /= 1 + (mean / config.outlier) ** 2
        current = current.step(_solve(slope, weight, mean, current.moved, config), focal)
        # Half of the variance that a line has if all distances are as likely.
        sharp = variance < (config.reach * scale) ** 2 / 6
        agrees = sharp & (np.abs(mean) < config.agreement_error)
        known = contour.lengths * seen[tuple(contour.inside.T)]  # the rest is beside the image
        agreement = float((agrees * known).sum() / max(known.sum(), 1e-9))
    return current, agreement


def _solve(
    slope: Float64, weight: Float64, mean: Float64, moved: Float64, config: ContourConfig
) -> Float64:
    """The delta (6,) that fits distances (N,) and stays near the given pose, `moved` (6,) away.

    `slope` (N, 6) is how the distances change with the delta.
    """
    weighted = slope * weight[:, None]
    prior = np.array(config.prior) ** -2.0
    normal = weighted.T @ slope + np.diag(prior)
    step = np.linalg.solve(normal, weighted.T @ mean - prior * moved)
    return np.asarray(step.clip(-config.max_step, config.max_step))


def jacobian(points: Float64, centre: Float64, focal: float) -> Float64:
    """Derivative of the pixels of points (N, 3) by the pose delta: (N, 2, 6).

    Points and the object's centre (3,) are in the virtual camera's frame, metres.
    """
    x, y, z = np.deg2rad(points - centre).T  # a turn of one degree moves a point crosswise to this
    moves = np.zeros((len(points), 3, 6))
    moves[:, 0, 0] = moves[:, 1, 1] = centre[2] / focal
    moves[:, :, 2] = -centre / OBJECT_SIZE
    moves[:, 1, 3], moves[:, 2, 3] = -z, y
    moves[:, 0, 4], moves[:, 2, 4] = z, -x
    moves[:, 0, 5], moves[:, 1, 5] = -y, x
    depth = points[:, 2, None, None]
    pixels: Float64 = (moves[:, :2] - points[:, :2, None] / depth * moves[:, 2:]) * focal / depth
    return pixels
