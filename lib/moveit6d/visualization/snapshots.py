"""Chooses frames of a finished run, fetches them again from the video, and draws them as pictures.

Never tracks and never holds more than one frame: reports of long videos need little memory.
"""

from __future__ import annotations

import base64
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch

from ..datasets.pose_files import PoseRow
from ..datasets.video import FrameSource, Image, ImageList, Prefetched, VideoFrame
from ..geometry.camera import Camera
from ..geometry.mesh import Mesh
from ..geometry.pose import Pose
from ..rendering.renderer import Renderer
from .overlay import GREEN, RED, blank, draw_pose

WHITE = (255, 255, 255)
WIDTH = 320  # pixels of a picture
ZOOM = 2.4  # sphere diameters that a picture from nearby shows
QUALITY = 82


@dataclass(frozen=True)
class Look:
    """What is drawn on one frame: the pose found, and the true one where it is known."""

    row: PoseRow
    confident: bool
    truth: Pose | None = None


def evenly(frames: Sequence[int], count: int) -> list[int]:
    """Up to `count` of the frames, evenly spread, the first and the last among them.

    Examples:
        >>> evenly(range(100), 3)
        [0, 50, 99]
    """
    if len(frames) <= count:
        return list(frames)
    places = np.linspace(0, len(frames) - 1, count).round().astype(int)
    return [frames[place] for place in places]


def worst(badness: Mapping[int, float], count: int) -> list[int]:
    """Up to `count` frames, the worst first, no two of them from the same short stretch.

    So a stretch where the object is lost shows its worst moment and leaves room for others: two
    frames are at least half of the even distance of `count` pictures apart. Of equally bad frames
    the earlier comes first.

    Examples:
        >>> worst({0: 0.1, 1: 0.9, 2: 0.8, 9: 0.5}, 2)
        [1, 2]
    """
    apart = max(1, len(badness) // (2 * count))
    chosen: list[int] = []
    for frame in sorted(badness, key=lambda frame: (-badness[frame], frame)):
        if all(abs(frame - other) >= apart for other in chosen):
            chosen.append(frame)
        if len(chosen) == count:
            break
    return chosen


def fetch(source: FrameSource, wanted: set[int]) -> Iterator[VideoFrame]:
    """The frames with these numbers, in order; of image files no others are opened."""
    files = source.source if isinstance(source, Prefetched) else source
    if isinstance(files, ImageList):
        for index in sorted(number for number in wanted if number < len(files.paths)):
            yield files.frame(index)
        return
    last = max(wanted, default=-1)
    for frame in files:
        if frame.index > last:
            return
        if frame.index in wanted:
            yield frame


def draw(image: Image | None, look: Look, mesh: Mesh, camera: Camera, renderer: Renderer) -> Image:
    """The RGB frame with the true outline in white and the found one in green, doubtful in red."""
    if image is None or image.shape[:2] != (camera.height, camera.width):
        return blank(camera)
    picture = image
    if look.truth is not None:
        picture = draw_pose(picture, mesh, look.truth, camera, renderer, color=WHITE, axes=False)
    if look.row.pose is not None:
        color = GREEN if look.confident else RED
        picture = draw_pose(picture, mesh, look.row.pose, camera, renderer, color=color)
    return picture


def near(image: Image, look: Look, mesh: Mesh, camera: Camera) -> Image:
    """The part of the frame around the object, and around where it was thought to be."""
    poses = [pose for pose in (look.truth, look.row.pose) if pose is not None]
    boxes = [box for pose in poses if (box := _around(mesh, pose, camera)) is not None]
    if not boxes:
        return image
    left, top = np.min([box[:2] for box in boxes], 0)
    right, bottom = np.max([box[2:] for box in boxes], 0)
    # The same shape as the frame, so that pictures stand in rows.
    tall = max(bottom - top, (right - left) * camera.height / camera.width, 48)
    tall, wide = min(tall, camera.height), min(tall * camera.width / camera.height, camera.width)
    x = int(np.clip((left + right - wide) / 2, 0, camera.width - wide))
    y = int(np.clip((top + bottom - tall) / 2, 0, camera.height - tall))
    return image[y : y + math.ceil(tall), x : x + math.ceil(wide)]


def as_data(image: Image, width: int = WIDTH) -> str:
    """The RGB picture, `width` pixels wide, as the address of a JPEG that a page holds itself."""
    from PIL import Image as Pillow

    height = max(1, round(image.shape[0] * width / image.shape[1]))
    scaled = Pillow.fromarray(np.ascontiguousarray(image)).resize((width, height))
    memory = io.BytesIO()
    scaled.save(memory, "JPEG", quality=QUALITY)
    return "data:image/jpeg;base64," + base64.b64encode(memory.getvalue()).decode("ascii")


def _around(mesh: Mesh, pose: Pose, camera: Camera) -> tuple[float, float, float, float] | None:
    """Left, top, right, bottom of a window around the object's sphere; None behind the camera."""
    center = mesh.inner(pose.to(torch.float64)).translation
    depth = float(center[2])
    if depth <= 0:
        return None
    x, y = camera.project(center).tolist()
    if not (0 <= x < camera.width and 0 <= y < camera.height):
        return None
    reach = 0.5 * ZOOM * mesh.sphere_diameter * camera.fx / depth
    return x - reach, y - reach, x + reach, y + reach
