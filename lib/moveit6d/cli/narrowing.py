"""What is known of where an object is: the options, and the pose in a first frame by them.

Never tracks.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..errors import InputError
from .messages import note

if TYPE_CHECKING:
    from ..datasets.video import VideoFrame
    from ..estimation.detection import Detection, PoseDetector
    from ..geometry.camera import Camera
    from ..geometry.pose import Pose
    from .common import Setting

NAMES = ("box", "mask", "points", "distance")
OF_ONE_FRAME = ("box", "mask", "points")  # and of one object
LOOK_FOR_IT = "none"  # of --start: the pose of this object is not known
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
        help="metres from the camera to the object"
        + (", then and wherever it is looked for later" if where else ""),
    )
    return known


def advice(args: argparse.Namespace) -> str:
    """What to check and what could narrow a search that found nothing, as the end of a sentence."""
    several = isinstance(args.mesh, list) and len(args.mesh) > 1
    names = ("distance", "start") if several else (*NAMES, "start")
    known = [f"--{name}" for name in names if getattr(args, name) is not None]
    free = " or ".join(f"--{name}" for name in names if getattr(args, name) is None)
    if not known:
        return f"; narrow the search by {free}"
    check = f"; check {' and '.join(known)}"
    return f"{check}, or narrow the search by {free}" if free else check


def start_file(text: str) -> Path | None:
    """One --start: a file, or None by the word for an object that is to be looked for."""
    return None if text == LOOK_FOR_IT else Path(text)


def searching_within(setting: Setting, distance: Sequence[float] | None) -> Setting:
    """The setting of a track whose lost objects are looked for in these distances, metres, too.

    `InputError` where the setting has others already.
    """
    if distance is None:
        return setting
    if setting.config.recovery.distance is not None:
        raise InputError(
            "--distance and the setting recovery.distance say the same; leave out one of them."
        )
    near, far = distance
    recovery = replace(setting.config.recovery, distance=(near, far))
    return replace(setting, config=replace(setting.config, recovery=recovery))


def is_narrowed(args: argparse.Namespace, names: Sequence[str] = NAMES) -> bool:
    """Whether one of the options, or of those with these names, is given."""
    return any(getattr(args, name) is not None for name in names)


def check_first(args: argparse.Namespace) -> None:
    """`InputError` where the options do not go with the others of `track`."""
    if not is_narrowed(args):
        return
    if len(args.mesh) > 1 and is_narrowed(args, OF_ONE_FRAME):
        raise InputError(
            "--box, --mask and --points are for one object; of several give --distance, which is "
            "for all that are looked for, or a --start for each."
        )
    if args.start and all(args.start):
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


def first_pose(
    detector: PoseDetector, first: VideoFrame, known: dict[str, Any], where: str = "the first frame"
) -> Pose | None:
    """The pose in a frame by what is known; None, and a note, if it is not found.

    Where the image does not confirm the pose of points, it is theirs. `where` names the frame.
    """
    assert first.image is not None  # the caller chose one that can be read
    found = detector.detect(first.image, **known)
    if found.pose is not None:
        return found.pose
    if known["points"] is not None:
        return unconfirmed(known["points"], detector.camera, found, where)[0]
    narrowed = any(value is not None for value in known.values())
    note(
        f"the object is not found in {where}{' where it should be' if narrowed else ''} "
        f"(probability {found.probability:.2f}); it is looked for in the whole image."
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
