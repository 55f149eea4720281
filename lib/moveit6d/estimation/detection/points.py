"""Poses from points that somebody clicked: pixels in the image and the places on the mesh.

Never sees an image.
"""

from __future__ import annotations

import csv
import logging
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from ...checks import shown
from ...errors import InputError
from ...geometry.camera import Camera
from ...geometry.lens import skewed
from ...geometry.mesh import METRES, Mesh
from ...geometry.pose import Pose
from ...io import read_text

LOG = logging.getLogger("moveit6d")
FEWEST = 4  # points: three leave several poses
FARTHEST = 0.1  # of the picture's longer side: points this far off are mixed up
SPREAD = 2.0  # pixels: points nearer together say nothing of a pose
FARTHEST_OFF = 1.0  # of the mesh's diameter, outside of its bounding sphere: not on the mesh
OFF_SURFACE = 0.05  # of the mesh's diameter: more than that beside it nobody clicks
SAMPLES = 20_000  # points that stand for the surface, a hundredth of the diameter apart
LEAST_EXTENT = 0.02  # of the mesh's diameter: nobody clicks so near together
COLUMNS = ("u", "v", "x", "y", "z")


def read_points(path: str | Path, unit: str) -> NDArray[np.float64]:
    """Rows u, v, x, y, z of a CSV file: pixels, and the mesh file's coordinates → metres (N, 5).

    A heading is optional; with one the columns may stand in any order. Where semicolons or tabs
    part the columns, commas are decimal commas. `InputError` where a row is not five numbers, and
    where the pixels are all the same: then columns are mixed up.
    """
    path = Path(path)
    rows = []
    order = list(range(5))
    try:
        text = read_text(path)
        first = text.lstrip().partition("\n")[0]
        delimiter = next((mark for mark in ";\t" if first.count(mark) == len(COLUMNS) - 1), ",")
        for number, cells in enumerate(csv.reader(text.splitlines(), delimiter=delimiter), 1):
            if delimiter != ",":
                cells = [cell.replace(",", ".") for cell in cells]
            if not any(cells):
                continue
            if number == 1 and not _is_number(cells[0]):
                order = _order(path, cells)
                continue
            if len(cells) != 5 or not all(
                _is_number(cell) and math.isfinite(float(cell)) for cell in cells
            ):
                raise InputError(
                    f"{path}, line {number}: five numbers {','.join(COLUMNS)} are needed, "
                    f"found {','.join(cells)[:120]!r}."
                )
            rows.append([float(cells[place]) for place in order])
    except csv.Error as error:
        raise InputError(f"{path} cannot be read as a CSV file of points: {error}.") from error
    points = np.array(rows, np.float64).reshape(-1, 5)
    if len(points) and float(np.ptp(points[:, :2], 0).max()) < SPREAD:
        raise InputError(
            f"{path}: its pixels lie within {SPREAD} pixels of each other; a row is "
            f"{','.join(COLUMNS)}, pixels first."
        )
    points[:, 2:] *= METRES[unit]
    return points


def _order(path: Path, heading: Sequence[str]) -> list[int]:
    """Where each of `COLUMNS` stands in a heading."""
    names = [name.strip().lower() for name in heading]
    if sorted(names) != sorted(COLUMNS):
        raise InputError(
            f"{path}: its heading is {','.join(heading)[:120]!r}; the columns are "
            f"{','.join(COLUMNS)}."
        )
    return [names.index(name) for name in COLUMNS]


def check_points(points: Any, mesh: Mesh) -> None:
    """`InputError` where (N, 5) rows lie off a mesh: in another unit, or in another frame.

    A warning where one is only beside its surface, as with another origin.
    """
    places = _rows(points)[:, 2:]
    away = float(np.linalg.norm(places - mesh.center, axis=1).max()) - mesh.sphere_diameter / 2
    extent = float(np.ptp(places, axis=0).max())
    if away > FARTHEST_OFF * mesh.sphere_diameter:
        found = f"lie up to {away:.3g} m from"
    elif extent < LEAST_EXTENT * mesh.sphere_diameter:
        found = f"span no more than {extent:.3g} m of"
    else:
        _warn_off_surface(places, mesh)
        return
    raise InputError(
        f"points: they {found} a mesh {mesh.sphere_diameter:.3g} m across; x, y, z must be in the "
        "mesh file's unit and frame."
    )


def _warn_off_surface(places: NDArray[np.float64], mesh: Mesh) -> None:
    surface = np.concatenate([mesh.vertices + mesh.center, mesh.sample_points(SAMPLES)])
    off = [float(np.linalg.norm(surface - place, axis=1).min()) for place in places]
    worst = int(np.argmax(off))
    if off[worst] > OFF_SURFACE * mesh.diameter:
        x, y, z = places[worst]
        LOG.warning(
            "points: number %d (%.4g, %.4g, %.4g m) lies %.2g m beside the surface of a mesh %.3g "
            "m across; x, y, z count from the mesh file's origin, which may be in its middle: "
            "`moveit6d doctor --mesh` prints from where to where the mesh reaches.",
            worst + 1, x, y, z, off[worst], mesh.diameter,
        )  # fmt: skip


def poses_from_points(points: Any, camera: Camera) -> list[Pose]:
    """Poses (mesh file's frame) that take (N, 5) rows u, v, x, y, z (pixels, metres) best.

    Several where the points leave a choice (points in a plane), the best first. SQPnP, then
    Levenberg–Marquardt on the reprojection error, both OpenCV's. The camera's lens distortion is
    taken into account: pixels are those of the image as it was taken. `InputError` for fewer than
    four points, or if no pose explains them.
    """
    import cv2

    rows = _rows(points)
    pixels, places = rows[:, :2].copy(), rows[:, 2:].copy()
    matrix = camera.matrix.numpy()
    if camera.lens is not None:
        pixels = camera.lens.undistort(pixels, matrix)
    # OpenCV leaves the skew out: solve for a camera without it.
    pixels[:, 0] -= skewed(pixels[:, 1], matrix)
    matrix[0, 1] = 0.0
    solutions: list[tuple[float, Any, Any]] = []
    for method in (cv2.SOLVEPNP_SQPNP, cv2.SOLVEPNP_IPPE):
        most = FARTHEST * max(camera.width, camera.height)
        solutions += _solve(places, pixels, matrix, method, most)
    solutions.sort(key=lambda one: one[0])
    found: list[Pose] = []
    for _, turn, place in solutions:
        pose = Pose.checked(cv2.Rodrigues(turn)[0], place.ravel(), "points")
        if float(pose.transform(torch.from_numpy(places))[:, 2].min()) > 0 and not any(
            torch.allclose(pose.rotation, other.rotation, atol=1e-3) for other in found
        ):
            found.append(pose)
    if not found:
        raise InputError(
            "points: no pose in front of the camera takes them to these pixels; check their order, "
            "the mesh's unit and that not all of them lie on one line."
        )
    return found


def _rows(points: Any) -> NDArray[np.float64]:
    """Checked rows u, v, x, y, z: (N, 5)."""
    try:
        rows = np.asarray(points, np.float64)
    except (TypeError, ValueError):
        raise InputError(f"points must be rows of numbers, found {shown(points)}.") from None
    if rows.ndim != 2 or rows.shape[1] != 5 or len(rows) < FEWEST or not np.isfinite(rows).all():
        raise InputError(
            f"points: at least {FEWEST} rows of {', '.join(COLUMNS)}, finite numbers, are needed, "
            f"found shape {rows.shape}."
        )
    return rows


def reprojection_error(points: Any, pose: Pose, camera: Camera) -> float:
    """How far (N, 5) rows are from where a pose takes them, pixels, root mean square."""
    rows = torch.from_numpy(np.array(points, np.float64))
    seen = camera.project(pose.to(torch.float64).transform(rows[:, 2:]))
    return float((seen - rows[:, :2]).square().sum(1).mean().sqrt())


def _solve(
    places: NDArray[Any], pixels: NDArray[Any], matrix: NDArray[Any], method: int, most: float
) -> Sequence[tuple[float, Any, Any]]:
    import cv2

    try:
        _, turns, shifts, _ = cv2.solvePnPGeneric(places, pixels, matrix, None, flags=method)
    except cv2.error:  # IPPE refuses points that are not in a plane; both refuse points on a line
        return []
    solutions = []
    for turn, shift in zip(turns, shifts, strict=True):
        turn, shift = cv2.solvePnPRefineLM(places, pixels, matrix, None, turn, shift)
        again = cv2.projectPoints(places, turn, shift, matrix, None)[0][:, 0]
        error = float(np.sqrt(((again - pixels) ** 2).sum(1).mean()))
        if error < most:
            solutions.append((error, turn, shift))
    return solutions


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
