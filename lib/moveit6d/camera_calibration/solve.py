"""The camera that explains where a board's corners are seen: Zhang's method, by OpenCV.

Never looks for corners.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
import torch
from numpy.typing import NDArray

from ..errors import InputError
from ..geometry.camera import Camera, with_possible_picture
from ..geometry.lens import DistortionModel
from .boards import Corners

LensKind = Literal["none", "standard", "rational", "fisheye"]
FEWEST = 6  # views; fewer do not tell the focal length from the distortion
MOST = 40  # views that are used: more cost time and say the same again
OUTLIER = 2.5  # times the median error, from which a view is left out: blurred or bent


@dataclass(frozen=True)
class Calibration:
    """A camera and how well it explains the corners.

    `error` is the root mean square distance in pixels, `views` the number of pictures used,
    `coverage` the share of the image's 8 × 8 cells in which corners were seen; `spread` the
    relative uncertainty of fx that OpenCV states, None for a fisheye.
    """

    camera: Camera
    error: float
    views: int
    coverage: float
    spread: float | None = None

    @property
    def field_of_view(self) -> float:
        """Degrees between what the middles of the picture's two shorter edges show."""
        camera, lens = self.camera, self.camera.lens
        u, v = (camera.width - 1) / 2, (camera.height - 1) / 2
        if camera.width >= camera.height:
            edges = np.array([[-0.5, v], [camera.width - 0.5, v]])
        else:
            edges = np.array([[u, -0.5], [u, camera.height - 0.5]])
        if lens is None:
            rays = camera.unproject(torch.from_numpy(edges)).numpy()
        else:
            rays = lens.directions(edges, camera.matrix.numpy())
        one, two = rays
        across = float(np.degrees(np.arctan2(np.linalg.norm(np.cross(one, two)), one @ two)))
        # Of a fisheye that sees behind itself the axis lies in the larger of the two angles.
        return across if one[2] + two[2] >= 0 else 360 - across

    def doubts(self) -> list[str]:
        """What speaks against trusting it, in sentences with what to do; empty if nothing does."""
        found = []
        if self.error > 1.0:
            found.append(
                f"the corners are {self.error:.2f} pixels off: sharper pictures of a board that is "
                "really flat are needed, with the --squares that it has"
            )
        if self.coverage < 0.5:
            found.append(
                f"corners were seen in {100 * self.coverage:.0f} % of the picture: move the board "
                "to its edges and corners too"
            )
        if self.spread is not None and self.spread > 0.02:
            found.append(
                f"the focal length is known to {100 * self.spread:.0f} % only: tilt the board by "
                "30 to 45 degrees in several directions"
            )
        return found


def choose_views(views: Sequence[Corners], width: int, height: int, count: int = MOST) -> list[int]:
    """Numbers of up to `count` views that differ most in place, size and tilt of the board."""
    if len(views) <= count:
        return list(range(len(views)))
    features = np.array([_feature(view, width, height) for view in views])
    chosen = [int(np.argmax([len(view.pixels) for view in views]))]
    distance = np.linalg.norm(features - features[chosen[0]], axis=1)
    while len(chosen) < count:
        chosen.append(int(distance.argmax()))
        distance = np.minimum(distance, np.linalg.norm(features - features[chosen[-1]], axis=1))
    return sorted(chosen)


def calibrate(
    views: Sequence[Corners], width: int, height: int, lens: LensKind = "standard"
) -> Calibration:
    """The camera of these views of one board; views that fit badly are left out.

    `lens`: `none`, `standard` (k1, k2, p1, p2, k3), `rational` (k4, k5, k6 too, for wide lenses)
    or `fisheye`. `InputError` if there are too few views or they fix no camera.
    """
    if len(views) < FEWEST:
        raise InputError(
            f"the board was found in {len(views)} pictures, at least {FEWEST} are needed; is it "
            "wholly in the picture, sharp and flat, and are --board, --squares and, of a charuco "
            "board, --dictionary right?"
        )
    kept = list(views)
    camera, errors, spread = _fit(kept, width, height, lens)
    sound = errors <= max(OUTLIER * float(np.median(errors)), 0.3)
    if not sound.all() and sound.sum() >= FEWEST:
        kept = [view for view, good in zip(views, sound, strict=True) if good]
        camera, errors, spread = _fit(kept, width, height, lens)
    _check_picture(camera, lens)
    weights = [len(view.pixels) for view in kept]
    error = float(np.sqrt(np.average(errors**2, weights=weights)))
    return Calibration(camera, error, len(kept), _coverage(kept, width, height), spread)


def _fit(
    views: Sequence[Corners], width: int, height: int, lens: LensKind
) -> tuple[Camera, NDArray[np.float64], float | None]:
    """The camera, the error of each view in pixels, and the relative uncertainty of fx."""
    import cv2

    # In one row: OpenCV 5's fisheye does not take columns.
    places = [view.places[None].astype(np.float64) for view in views]
    pixels = [view.pixels[None].astype(np.float64) for view in views]
    size, spread = (width, height), None
    try:
        if lens == "fisheye":
            flags = _fisheye_flag("CALIB_RECOMPUTE_EXTRINSIC") | _fisheye_flag("CALIB_FIX_SKEW")
            _, k, d, turns, shifts = cv2.fisheye.calibrate(
                places, pixels, size, np.eye(3), np.zeros((4, 1)), flags=flags
            )
        else:
            _, k, d, turns, shifts, deviations, _, _ = cv2.calibrateCameraExtended(
                [one.astype(np.float32) for one in places],
                [one.astype(np.float32) for one in pixels],
                size,
                None,
                None,
                flags=_flags(lens),
            )
            spread = float(np.ravel(deviations)[0] / k[0, 0])
    except cv2.error as error:
        raise InputError(
            f"these pictures fix no camera ({str(error).splitlines()[0][:120].strip()}); show the "
            "board at several distances, places and tilts."
        ) from None
    count = 8 if lens == "rational" else 5
    coefficients = None if lens == "none" else tuple(np.ravel(d)[:count].tolist())
    # Not from_matrix: a few bad views, yet to be left out, may make the lens fold the picture.
    model: DistortionModel = "fisheye" if lens == "fisheye" else "opencv"
    focal, centre = (k[0, 0], k[1, 1]), (k[0, 2], k[1, 2])
    camera = Camera(*focal, *centre, width, height, coefficients, model, k[0, 1])
    errors = [_error(*one, camera) for one in zip(views, turns, shifts, strict=True)]
    return camera, np.array(errors), spread


def _check_picture(camera: Camera, lens: LensKind) -> None:
    """`InputError` with what to do, if the lens that fits best cannot show such a picture."""
    try:
        with_possible_picture(camera)
    except InputError:
        other = ", or take --lens standard" if lens == "rational" else ""
        raise InputError(
            f"the {lens} lens that fits these pictures best folds or stretches the picture where "
            "they say little of it, towards its corners; take more pictures with the board in the "
            f"corners{other}."
        ) from None


def _flags(lens: LensKind) -> int:
    import cv2

    if lens == "none":
        fixed = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3
        return int(fixed | cv2.CALIB_ZERO_TANGENT_DIST)
    return int(cv2.CALIB_RATIONAL_MODEL) if lens == "rational" else 0


def _fisheye_flag(name: str) -> int:
    """OpenCV 4 has the fisheye's flags in its own module, OpenCV 5 among the others."""
    import cv2

    return int(getattr(cv2.fisheye, name, None) or getattr(cv2, name))


def _error(
    view: Corners, turn: NDArray[np.float64], shift: NDArray[np.float64], camera: Camera
) -> float:
    """Root mean square distance of a view's corners from where the camera puts them, pixels."""
    import cv2

    points = view.places.astype(np.float64) @ cv2.Rodrigues(np.ravel(turn))[0].T + np.ravel(shift)
    pixels = camera.project(torch.from_numpy(points)).numpy()
    return float(np.sqrt(((pixels - view.pixels) ** 2).sum(1).mean()))


def _coverage(views: Sequence[Corners], width: int, height: int) -> float:
    seen = np.zeros((8, 8), bool)
    for view in views:
        cells = (view.pixels / (width, height) * 8).astype(int).clip(0, 7)
        seen[cells[:, 1], cells[:, 0]] = True
    return float(seen.mean())


def _feature(view: Corners, width: int, height: int) -> NDArray[np.float64]:
    """Where the board is, how large, and how it is tilted, in numbers of about the same range."""
    import cv2

    diagonal = float(np.hypot(width, height))
    homography, _ = cv2.findHomography(view.places[:, :2], view.pixels)
    if homography is None:
        homography = np.eye(3)
    # The last row says how much nearer one side of the board is than the other.
    span = float(np.ptp(view.places[:, :2]))
    tilt = np.clip(homography[2, :2] / homography[2, 2] * span, -1, 1)
    size = np.ptp(view.pixels, axis=0).mean() / diagonal
    return np.array([*(view.pixels.mean(0) / (width, height)), size, *tilt])
