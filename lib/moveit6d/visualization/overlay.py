"""Draws poses on frames: the outline of the object and the axes of its frame.

Never moves a pose. The contour comes from a rendered mask, so it is that of the estimate, and
it is drawn on the frame as it was taken, lens distortion included.
"""

from __future__ import annotations

import math

import numpy as np
import torch
from numpy.typing import NDArray

from ..datasets.video import Image
from ..geometry.camera import Camera
from ..geometry.crop import OBJECT_SIZE, PATCH_SIZE, look_at
from ..geometry.images import rgb_bytes
from ..geometry.inputs import camera_of, pose_of
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..rendering.backends import make_renderer
from ..rendering.renderer import Renderer
from ..typing import ImageLike

GREEN = (40, 255, 80)
RED = (255, 60, 60)
AXIS_COLORS = ((255, 60, 60), (60, 255, 60), (80, 120, 255))  # x, y, z
SIZES = (128, 640)  # pixels a side of the mask that the outline is taken from
_SHIFT = 4  # OpenCV draws in sixteenths of a pixel


def outlines(mesh: Mesh, pose: Pose, camera: Camera, renderer: Renderer) -> list[NDArray[np.int32]]:
    """Closed outlines (N, 2), holes included, of an object in sixteenths of the frame's pixels.

    `pose` is in the mesh file's frame. Empty for an object behind the camera.
    """
    import cv2

    centred = mesh.inner(pose.to(torch.float64))
    if float(centred.translation[2]) <= 0:
        return []
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    view = look_at(centred, diameter)
    # About one pixel of the mask for one of the frame.
    wide = camera.fx * mesh.sphere_diameter / float(view.distance) * PATCH_SIZE / OBJECT_SIZE
    size = int(min(max(64 * math.ceil(wide / 64), SIZES[0]), SIZES[1]))
    matrix = view.intrinsics * (size / PATCH_SIZE)
    matrix[:2, 2] = (size - 1) / 2
    matrix[2, 2] = 1
    virtual = view.to_virtual(centred)
    mask = renderer.render([mesh], virtual[None], matrix[None], size).mask[0, 0]
    found, _ = cv2.findContours(
        (mask.cpu().numpy() > 0.5).astype(np.uint8), cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE
    )
    back = view.rotation.mT.numpy() @ np.linalg.inv(matrix.numpy())
    return [_on_frame(_rays(contour[:, 0], back), camera) for contour in found if len(contour) > 2]


def draw_pose(
    image: ImageLike,
    mesh: Mesh,
    pose: Pose,
    camera: Camera,
    renderer: Renderer | None = None,
    *,
    color: tuple[int, int, int] = GREEN,
    axes: bool = True,
) -> Image:
    """A copy of the RGB frame (H, W, 3) with the object's contour and, at its centre, its axes.

    `pose` is in the mesh file's frame; `renderer` is embree if None. The copy is uint8, whatever
    kind of image it is of. `InputError` for an image that is not the camera's, and for no pose.
    """
    import cv2

    renderer = make_renderer() if renderer is None else renderer
    picture = np.array(rgb_bytes(image, camera_of(camera)), order="C")
    pose = pose_of(pose, "The pose")
    width = max(1, round(min(picture.shape[:2]) / 300))
    for closed in outlines(mesh, pose, camera, renderer):
        cv2.polylines(picture, [closed], True, color, width, cv2.LINE_AA, _SHIFT)
    if axes:
        for line, tint in zip(_axes(mesh, pose, camera), AXIS_COLORS, strict=False):
            cv2.polylines(picture, [line], False, tint, width + 1, cv2.LINE_AA, _SHIFT)
    return picture


def draw_text(image: Image, text: str, color: tuple[int, int, int] = GREEN, line: int = 0) -> Image:
    """A copy of the RGB frame with a line of text at its bottom left, readable on any ground.

    `line` counts from the lowest one up.
    """
    from PIL import Image as Pillow
    from PIL import ImageDraw, ImageFont

    picture = Pillow.fromarray(np.ascontiguousarray(image))
    size = max(11, round(min(image.shape[:2]) / 28))
    font = ImageFont.load_default(size)
    place = (8, image.shape[0] - round(size * (1 + 1.3 * line)) - 10)
    ImageDraw.Draw(picture).text(place, text, color, font, stroke_width=2, stroke_fill=(0, 0, 0))
    return np.array(picture)


def blank(camera: Camera) -> Image:
    """A black frame, for where the video has none."""
    return np.zeros((camera.height, camera.width, 3), np.uint8)


def _axes(mesh: Mesh, pose: Pose, camera: Camera) -> list[NDArray[np.int32]]:
    """Three lines from the object's centre, half a diameter long; none if one ends behind us."""
    tips = torch.cat([torch.zeros(1, 3), torch.eye(3)]).to(torch.float64)
    points = mesh.inner(pose.to(torch.float64)).transform(tips * (0.5 * mesh.sphere_diameter))
    if float(points[:, 2].min()) <= 0:
        return []
    pixels = _on_frame(points.numpy(), camera)
    return [pixels[[0, k]] for k in (1, 2, 3)] if len(pixels) == len(points) else []


def _rays(pixels: NDArray[np.int32], back: NDArray[np.float64]) -> NDArray[np.float64]:
    homogeneous = np.concatenate([pixels, np.ones((len(pixels), 1))], 1)
    rays = homogeneous @ back.T
    return np.asarray(rays[rays[:, 2] > 0])


def _on_frame(points: NDArray[np.float64], camera: Camera) -> NDArray[np.int32]:
    """Pixels (N, 2) of points (N, 3) in front of the camera through its lens, in sixteenths.

    Points that the lens does not show are left out.
    """
    if camera.lens is not None:
        points = points[camera.lens.shows(points)]
    pixels = camera.project(torch.from_numpy(points)).numpy()
    far = 1 << 20  # keeps what lies far outside of the frame within OpenCV's integers
    return np.asarray((pixels * (1 << _SHIFT)).round().clip(-far, far), np.int32)
