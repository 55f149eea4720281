"""BOP's visible surface discrepancy: how much of what is seen of an object lies elsewhere.

Never reads files. Distances are those from the camera's centre, not depths along its axis; 0 means
that there is nothing, or that nobody knows. (bop_toolkit, pose_error.vsd and visibility.)
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import torch
from torch import Tensor

from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...rendering.renderer import Renderer
from ..bop.matching import SHARES

DELTA = 0.015  # metres: how far behind the seen surface still counts as seen
DELTAS = {"itodd": 0.005}  # data sets with a tolerance of their own
Window = tuple[int, int, int, int]  # first column and row, and those after the last


def vsd(
    estimate: Tensor,
    truth: Tensor,
    seen: Tensor,
    diameter: float,
    delta: float = DELTA,
    taus: Sequence[float] = SHARES,
) -> Tensor:
    """VSD of one estimate for each tolerance (T,), from distance images (H, W) in metres.

    `estimate` and `truth` are rendered, `seen` is measured; `taus` are in diameters. Pixels where
    nothing was measured count as visible (BOP since 2019).
    """
    in_truth = _visible(truth, seen, delta)
    in_estimate = _visible(estimate, seen, delta) | (in_truth & (estimate > 0))
    both, either = in_truth & in_estimate, in_truth | in_estimate
    total = int(either.sum())
    if not total:
        return torch.ones(len(taus), dtype=torch.float64)
    apart = (truth[both] - estimate[both]).abs().double() / diameter
    wrong = [int((apart >= tau).sum()) + total - int(both.sum()) for tau in taus]
    return torch.tensor(wrong, dtype=torch.float64) / total


def distance_image(depth: Tensor, camera: Camera, window: Window | None = None) -> Tensor:
    """Depths along the axis (H, W) as distances from the camera's centre, of the whole image.

    With a window the depths are those of this part of the image only.
    """
    x0, y0 = (0, 0) if window is None else window[:2]
    rows = torch.arange(depth.shape[0], dtype=torch.float64, device=depth.device) + y0
    columns = torch.arange(depth.shape[1], dtype=torch.float64, device=depth.device) + x0
    x, y = (columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy
    return depth * (1 + x[None] ** 2 + y[:, None] ** 2).sqrt().to(depth)


def window_of(poses: Sequence[Pose], mesh: Mesh, camera: Camera) -> Window:
    """The part of the image outside of which the object is not seen at any of the poses.

    Poses belong to the mesh file's frame.
    """
    radius = mesh.sphere_diameter / 2
    boxes = [_box(mesh.inner(pose).translation, radius, camera) for pose in poses]
    left, top, right, bottom = zip(*boxes, strict=True)
    x0 = min(max(min(left), 0), camera.width - 1)
    y0 = min(max(min(top), 0), camera.height - 1)
    x1 = min(max(max(right), x0 + 1), camera.width)
    y1 = min(max(max(bottom), y0 + 1), camera.height)
    return (x0, y0, x1, y1)


def render_distances(
    mesh: Mesh, poses: Sequence[Pose], camera: Camera, window: Window, renderer: Renderer
) -> list[Tensor]:
    """What a camera would measure of the object at each pose (mesh file's frame), in the window."""
    x0, y0, x1, y1 = window
    inner = Pose.stack([mesh.inner(pose) for pose in poses])
    matrix = camera.crop(x0, y0, x1 - x0, y1 - y0).matrix.expand(len(poses), 3, 3)
    side = max(x1 - x0, y1 - y0)
    depths = renderer.render([mesh] * len(poses), inner, matrix, side).depth
    return [distance_image(one[0, : y1 - y0, : x1 - x0], camera, window) for one in depths]


def _visible(model: Tensor, seen: Tensor, delta: float) -> Tensor:
    return (model > 0) & ((model - seen <= delta) | (seen == 0))


def _box(centre: Tensor, radius: float, camera: Camera) -> Window:
    """A box around the picture of a sphere; the whole image where it comes near the camera."""
    x, y, z = centre.tolist()
    near, far = z - radius, z + radius
    if near <= 0.01 * radius:
        return (0, 0, camera.width, camera.height)
    return (
        math.floor(camera.fx * min((x - radius) / near, (x - radius) / far) + camera.cx),
        math.floor(camera.fy * min((y - radius) / near, (y - radius) / far) + camera.cy),
        math.ceil(camera.fx * max((x + radius) / near, (x + radius) / far) + camera.cx) + 1,
        math.ceil(camera.fy * max((y + radius) / near, (y + radius) / far) + camera.cy) + 1,
    )
