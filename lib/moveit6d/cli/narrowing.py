"""What is known of where an object is: the options, and the pose in a first frame by them.

Never tracks.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .messages import note

if TYPE_CHECKING:
    from ..datasets.video import VideoFrame
    from ..estimation.detection import Detection, PoseDetector
    from ..geometry.camera import Camera
    from ..geometry.pose import Pose

NAMES = ("box", "mask", "points", "distance")
DARK, HALF, WHITE = 16, 128, 224  # of 255, in a picture of a mask
MOST_OF_IMAGE = 0.95  # a mask of more is a mistake


def add_narrowing_options(parser: argparse.ArgumentParser, where: str = "") -> Any:
    """Options that say where the object is, in a group of their own; `where`: in which image."""
    known = parser.add_argument_group(f"what is known{where}")
    known.add_argument(
        "--box",
        type=float,
        nargs=4,
        metavar=("X", "Y", "W", "H"),
        help="left, top, width and height, pixels, around what is visible of the object",
    )
    known.add_argument(
        "--mask",
        type=Path,
        metavar="FILE",
        help="picture that is black, or transparent, outside of the object",
    )
    known.add_argument(
        "--points",
        type=Path,
        metavar="FILE",
        help="CSV of four or more rows u,v,x,y,z: pixels, and where they are in the mesh file",
    )
    known.add_argument(
        "--distance",
        type=float,
        nargs=2,
        metavar=("MIN", "MAX"),
        help="metres from the camera to the object",
    )
    return known


def advice(args: argparse.Namespace) -> str:
    """What could still narrow a search that found nothing, as the end of a sentence."""
    several = isinstance(args.mesh, list) and len(args.mesh) > 1
    names = ("start",) if several else (*NAMES, "start")
    free = [f"--{name}" for name in names if getattr(args, name) is None]
    return f"; narrow the search by {' or '.join(free)}" if free else ""


def is_narrowed(args: argparse.Namespace) -> bool:
    """Whether one of the options is given."""
    return any(getattr(args, name) is not None for name in NAMES)


def check_first(args: argparse.Namespace) -> None:
    """`InputError` where the options do not go with the others of `track`."""
    if not is_narrowed(args):
        return
    if len(args.mesh) > 1:
        raise InputError(
            "--box, --mask, --points and --distance are for one object; of several give a --start "
            "for each."
        )
    if args.start:
        raise InputError("--start says the pose; leave out --box, --mask, --points and --distance.")


def known_of(args: argparse.Namespace, unit: str) -> dict[str, Any]:
    """What the options say, as `PoseDetector.detect` takes it; `unit` is that of the points."""
    from ..estimation.detection.points import read_points

    return {
        "box": args.box,
        "mask": None if args.mask is None else read_mask(args.mask),
        "points": None if args.points is None else read_points(args.points, unit),
        "distance": args.distance,
    }


def first_pose(detector: PoseDetector, first: VideoFrame, known: dict[str, Any]) -> Pose | None:
    """The pose in a video's first frame by what is known; None, and a note, if it is not found.

    Where the image does not confirm the pose of points, it is theirs.
    """
    if first.image is None:
        raise InputError(f"the first frame is no use: {first.error}")
    found = detector.detect(first.image, **known)
    if found.pose is not None:
        return found.pose
    if known["points"] is not None:
        return unconfirmed(known["points"], detector.camera, found, "the first frame")[0]
    note(
        "the object is not found in the first frame where it should be (probability "
        f"{found.probability:.2f}); it is looked for in the whole image."
    )
    return None


def unconfirmed(points: Any, camera: Camera, found: Detection, where: str) -> tuple[Pose, float]:
    """The pose of points, how many pixels they are off it, and a note that nothing confirms it."""
    from ..estimation.detection.points import poses_from_points, reprojection_error

    pose = poses_from_points(points, camera)[0]
    error = reprojection_error(points, pose, camera)
    note(
        f"{where} does not confirm the pose of --points (probability {found.probability:.2f}), "
        f"which is taken as they say; they are {error:.1f} pixels off it."
    )
    return pose, error


def read_mask(path: Path) -> Any:
    """A mask picture (H, W): where it is not transparent if it is a cut-out, else not black.

    Of a black and white picture with greys (JPEG, smooth edges) its lighter half is the mask.
    """
    import numpy as np

    from ..datasets.video import opened_image

    with opened_image(path) as picture:
        clear = picture.mode in ("RGBA", "LA", "PA") or "transparency" in picture.info
        alpha = np.asarray(picture.convert("RGBA"))[..., 3] if clear else np.zeros(1)
        grey = np.asarray(picture.convert("L"))
        least = DARK if picture.format == "JPEG" else 1  # whose black is not quite black
    if alpha.min() < HALF <= alpha.max():
        mask = alpha >= HALF
    else:
        lit, white = (int((grey >= level).sum()) for level in (least, WHITE))
        # Where most is neither black nor white it is labels, or the object itself on black.
        mask = grey >= (HALF if 2 * white > lit else least)
    if mask.mean() > MOST_OF_IMAGE:
        note(
            f"{path}: the mask is {100 * mask.mean():.0f} % of the image, so that it narrows "
            "nothing; it should be black, or transparent, outside of the object."
        )
    return mask
