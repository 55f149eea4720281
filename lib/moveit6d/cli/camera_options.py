"""The options that say which camera took the images: a file, or nothing but its field of view.

Never tracks.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .messages import detail

if TYPE_CHECKING:
    from ..datasets.video import FrameSource
    from ..geometry.camera import Camera

CAMERA_FILES = """\
  --camera  a camera file: our {"fx", "fy", "cx", "cy", "width", "height", "distortion": [...]} in
            pixels, pixel (0, 0) being the centre of the top-left one; ROS camera_info, OpenCV's
            YAML or XML, RealSense's and Kalibr's names. `moveit6d calibrate` makes one
"""


def add_camera_options(group: Any, required: bool = True) -> None:
    """--camera, or --fov for who has no such file."""
    either = group.add_mutually_exclusive_group(required=required)
    either.add_argument("--camera", type=Path, metavar="FILE", help="intrinsics (camera.json, …)")
    either.add_argument(
        "--fov",
        type=float,
        metavar="DEGREES",
        help="instead of --camera: field of view along the longer side (phones: 60 to 75); rough",
    )


def camera_of(args: argparse.Namespace, frames: FrameSource) -> Camera:
    """The camera of the options for frames of a source; `InputError` if none can be read."""
    from ..geometry.camera import Camera

    if args.camera is not None:
        camera = Camera.load(args.camera)
    else:
        width, height = _size(frames)
        # Pixels that are no squares (DV, HDV): the field of view is that of the picture as shown.
        wide = round(width * getattr(frames, "sample_aspect_ratio", 1))
        camera = Camera.from_fov(args.fov, max(1, wide), height).resize(width, height)
    detail(f"camera: {camera}")
    return camera


def _size(frames: FrameSource) -> tuple[int, int]:
    """Width and height of the first frame that can be read; a live source says it by itself."""
    size: tuple[int, int] | None = getattr(frames, "size", None)
    if size is not None:
        return size
    for frame in frames:
        if frame.image is not None:
            return frame.image.shape[1], frame.image.shape[0]
    raise InputError("--fov needs the size of the images, and no frame can be read.")
