"""VSD on images made by hand, and distances of a box against its exact ray casting."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from moveit6d.evaluation.bop.matching import SHARES
from moveit6d.evaluation.metrics.vsd import distance_image, render_distances, vsd, window_of
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3
from moveit6d.rendering.backends import make_renderer
from tests.support.meshes import colored_box

CAMERA = Camera(180.0, 184.0, 78.0, 61.5, 160, 120)
EXTENTS = (0.1, 0.06, 0.04)


def image(*values: float) -> torch.Tensor:
    return torch.tensor([values], dtype=torch.float64)


def test_pixels_one_by_one() -> None:
    # both near / both far apart / only the truth / only the estimate / nothing
    truth = image(1.0, 1.0, 1.0, 0.0, 0.0)
    found = image(1.004, 1.03, 0.0, 1.0, 0.0)
    seen = image(1.0, 1.0, 1.0, 1.0, 1.0)
    errors = vsd(found, truth, seen, diameter=0.1)
    # The pixel 4 mm off is wrong for no tolerance, the one 30 mm off for those up to 0.3.
    assert errors.tolist() == [3 / 4 if tau <= 0.3 else 2 / 4 for tau in SHARES]


def test_what_stands_before_the_object_hides_it() -> None:
    truth, found = image(1.0, 1.0), image(1.0, 1.0)
    assert vsd(found, truth, image(0.98, 0.5), 0.1).tolist() == [1.0] * 10  # both 2 cm or more
    assert vsd(found, truth, image(0.99, 0.5), 0.1).tolist() == [0.0] * 10  # 1 cm is tolerated
    assert vsd(found, truth, image(0.99, 0.5), 0.1, delta=0.005).tolist() == [1.0] * 10


def test_missing_depth_counts_as_visible() -> None:
    assert vsd(image(1.0), image(1.0), image(0.0), 0.1).tolist() == [0.0] * 10


def test_an_estimate_behind_the_seen_surface_is_visible_where_the_truth_is() -> None:
    # 5 cm behind what is seen, but the truth is seen there: compared, and wrong up to 0.5 d.
    assert vsd(image(1.05), image(1.0), image(1.0), 0.1, taus=(0.4, 0.6)).tolist() == [1.0, 0.0]


def test_nothing_in_sight_is_wrong() -> None:
    assert vsd(image(0.0), image(0.0), image(1.0), 0.1).tolist() == [1.0] * 10


def cast(pose: Pose, camera: Camera) -> NDArray[np.float64]:
    """Distances of the box by slabs, a ray a pixel."""
    half = np.array(EXTENTS) / 2
    v, u = np.mgrid[: camera.height, : camera.width]
    rays = np.stack(
        [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)], -1
    )
    rays = rays / np.linalg.norm(rays, axis=-1, keepdims=True) @ pose.rotation.numpy()
    origin = pose.inverse().translation.numpy()
    near, far = (-half - origin) / rays, (half - origin) / rays
    enter, leave = np.minimum(near, far).max(-1), np.maximum(near, far).min(-1)
    return np.where((enter > 0) & (enter <= leave), enter, 0.0)


def at(turn: tuple[float, float, float], place: tuple[float, float, float]) -> Pose:
    return Pose(
        exp_so3(torch.tensor(turn, dtype=torch.float64)),
        torch.tensor(place, dtype=torch.float64),
    )


@pytest.mark.parametrize("place", [(0.01, -0.02, 0.5), (0.19, 0.13, 0.5)])  # whole, cut by a corner
def test_rendered_distances_are_those_of_the_rays(place: tuple[float, float, float]) -> None:
    box, pose = colored_box(EXTENTS), at((0.4, 0.7, -0.2), place)
    window = x0, y0, x1, y1 = window_of([pose], box, CAMERA)
    (found,) = render_distances(box, [pose], CAMERA, window, make_renderer())
    whole = np.zeros((CAMERA.height, CAMERA.width))
    whole[y0:y1, x0:x1] = found.numpy()
    expected = cast(pose, CAMERA)
    assert expected.max() > 0.4
    both = (whole > 0) & (expected > 0)
    assert (whole > 0).sum() == pytest.approx((expected > 0).sum(), abs=2)
    assert np.abs(whole - expected)[both].max() < 1e-5
    assert (x1 - x0) * (y1 - y0) < 0.5 * expected.size


@pytest.mark.parametrize("place", [(0.0, 0.0, 0.05), (0.0, 0.0, -0.5), (9.0, 0.0, 0.5)])
def test_a_window_is_never_empty(place: tuple[float, float, float]) -> None:
    x0, y0, x1, y1 = window_of([at((0, 0, 0), place)], colored_box(EXTENTS), CAMERA)
    assert 0 <= x0 < x1 <= CAMERA.width and 0 <= y0 < y1 <= CAMERA.height


def test_a_window_shifts_the_rays() -> None:
    depth = torch.full((120, 160), 2.0)
    whole = distance_image(depth, CAMERA)
    part = distance_image(depth[30:50, 100:140], CAMERA, (100, 30, 140, 50))
    torch.testing.assert_close(part, whole[30:50, 100:140])
    expected = 2 * np.sqrt(1 + ((100 - 78) / 180) ** 2 + ((30 - 61.5) / 184) ** 2)
    assert float(part[0, 0]) == pytest.approx(expected)
