"""Whether poses agree with what is known of where the object is: the box, the mask, the distance.

Never searches and never refines a pose.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from ...config import RegionConfig
from ...errors import InputError
from ...geometry.camera import Camera
from ...geometry.mesh import Mesh
from ...geometry.pose import Pose
from ...geometry.visibility import seen_box
from ..visibility import check_start
from .points import check_points, poses_from_points
from .region import SearchRegion, overlap, width_at

DEFAULT = RegionConfig()


def disagreement(
    known: SearchRegion,
    mesh: Mesh,
    camera: Camera,
    centred: Pose,
    shift: float = 0.0,
    ratio: float | None = None,
    config: RegionConfig = DEFAULT,
) -> str | None:
    """What a centred pose contradicts, and where it has the object; None if it agrees with all.

    `camera` took the image, `known` is that of the image without its lens. `ratio` is how far off
    its distance may be (None: as in `config`), `shift` how far aside it may be, in widths of the
    object.
    """
    distance, radius = float(centred.translation.norm()), mesh.sphere_diameter / 2
    if known.distance is not None:
        near, far = known.distance
        ratio = config.distance_ratio if ratio is None else ratio
        if distance * ratio + radius < near or distance / ratio - radius > far:
            where = f"by the pose the object is {distance:.3g} m away"
            return f"{_named('distance', known.distance)} contradict each other: {where}"
    bounds = known.bounds
    if bounds is None:
        return None
    left, top, right, bottom = seen_box(centred, mesh, camera.full_pinhole)
    x, y, z = centred.translation.tolist()
    tangent = float(np.hypot(x, y)) / max(z, radius)  # of a start at z = 0 it would have no end
    margin = shift * _longest(mesh, camera, distance, tangent)
    grown = (left - margin, top - margin, right + margin, bottom + margin)
    if _covered(known, grown) >= config.least_covered:
        return None
    name, where = _name_of_box(known), f"{left:.0f} {top:.0f} {right - left:.0f} {bottom - top:.0f}"
    if camera.lens is not None:  # those are no pixels of the user's image
        name = "box" if known.mask is None else "mask"
        u, v = camera.project(centred.translation).tolist()
        where = f"pixel {u:.0f}, {v:.0f}"
    return f"{name} contradict each other: by the pose the object is at {where}"


def given_poses(
    known: SearchRegion,
    mesh: Mesh,
    camera: Camera,
    points: Any,
    instances: int,
    config: RegionConfig,
) -> list[Pose]:
    """The start pose and those of clicked points (mesh file's frame), as far as they are given.

    `camera` is that of the image as it was taken, `known` that of the image without its lens.
    `InputError` where one of them cannot be used, or contradicts what else is known.
    """
    _check_known(known, mesh, camera, config)
    found = []
    if known.near is not None:
        check_start(known.near, mesh, camera)
        shift, ratio = config.near_shift, config.near_ratio  # it is only roughly right
        centred = mesh.inner(known.near)
        _refuse(
            "start pose",
            disagreement(known, mesh, camera, centred, shift, ratio, config),
        )
        found.append(known.near)
    if points is not None:
        if instances > 1:
            raise InputError(
                f"points are of one instance, and {instances} are looked for; leave one out."
            )
        check_points(points, mesh)
        clicked = poses_from_points(points, camera)
        centred = mesh.inner(clicked[0])
        _refuse("points", disagreement(known, mesh, camera, centred, config=config))
        found += clicked
    return found


def _refuse(name: str, problem: str | None) -> None:
    if problem is not None:
        raise InputError(f"{name} and {problem}; leave one of them out.")


def _check_known(known: SearchRegion, mesh: Mesh, camera: Camera, config: RegionConfig) -> None:
    """`InputError` for a box or mask that is too large for the object at any distance given."""
    if known.distance is None or known.bounds is None:
        return
    (x, y, width, height), nearest = known.bounds, known.distance[0]
    corners = torch.tensor([[u, v] for u in (x, x + width) for v in (y, y + height)]).double()
    tangent = float(camera.full_pinhole.unproject(corners)[:, :2].norm(dim=1).max())
    longest, side = _longest(mesh, camera, nearest, tangent), max(width, height)
    if config.longest_ratio * longest < config.box_ratio[0] * side:
        # Once a lens is undone, pixels are no longer those of the user's image.
        what = "box" if known.mask is None else "mask"
        raise InputError(
            f"{_named('distance', known.distance)} and {what} contradict each other: even at "
            f"{nearest:g} m the object would be no more than {100 * longest / side:.0f} % as long "
            f"as the {what}; check the metres and the mesh's unit."
        )


def _longest(mesh: Mesh, camera: Camera, distance: float, tangent: float) -> float:
    """Pixels that the object is long at most, so far from the axis (tangent of the angle to it).

    A pinhole image, which has no lens, draws things out from the axis by 1 / cos² of the angle.
    """
    return width_at(distance, mesh, camera) * (1 + tangent**2)


def _covered(known: SearchRegion, edges: tuple[float, float, float, float]) -> float:
    """Share of the mask's pixels, or of the box, within edges (left, top, right, bottom)."""
    if known.mask is not None:
        left, top, right, bottom = edges
        rows, columns = np.nonzero(known.mask)
        inside = (left <= columns) & (columns <= right) & (top <= rows) & (rows <= bottom)
        return float(inside.mean())
    assert known.bounds is not None
    return float(overlap(torch.tensor([edges]), known.bounds)[1])


def _name_of_box(known: SearchRegion) -> str:
    around = _named("box", known.bounds or ())
    return around if known.mask is None else f"mask (its {around})"


def _named(name: str, numbers: tuple[float, ...]) -> str:
    return f"{name} {' '.join(f'{number:.6g}' for number in numbers)}"
