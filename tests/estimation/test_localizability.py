"""What a pixel of width is worth: against a projection and a count of drawn errors."""

import numpy as np
import pytest
import torch

from moveit6d.estimation import StopReason, TrackingResult
from moveit6d.estimation.localizability import LIMIT, localizability
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose


def at(distance: float) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([0, 0, distance], dtype=torch.float64))


WIDTH_ERROR = 1.5  # pixels


@pytest.mark.parametrize(("focal", "distance"), [(600.0, 1.2), (600.0, 0.8), (1800.0, 1.2)])
def test_it_is_the_share_of_drawn_width_errors_that_keep_the_depth(
    brick: Mesh, focal: float, distance: float
) -> None:
    camera = Camera(focal, focal, 319.5, 239.5, 640, 480)
    width = focal * brick.diameter / distance
    drawn = width + np.random.default_rng(0).normal(0, WIDTH_ERROR, 200_000)
    error = np.abs(focal * brick.diameter / drawn - distance)
    share = (error < LIMIT * brick.diameter).mean()
    centred = at(distance)
    assert localizability(centred, brick, camera, WIDTH_ERROR) == pytest.approx(share, abs=0.01)


def test_near_objects_and_long_lenses_say_more(brick: Mesh) -> None:
    camera = Camera(600, 600, 319.5, 239.5, 640, 480)
    long = Camera(1200, 1200, 319.5, 239.5, 640, 480)
    chances = [
        localizability(at(z), brick, camera, WIDTH_ERROR) for z in (0.5, 1.0, 2.0, 4.0, 50.0)
    ]
    assert chances == sorted(chances, reverse=True)
    assert chances[0] > 0.999
    assert 0 < chances[-1] < 0.05
    assert localizability(at(2.0), brick, long, WIDTH_ERROR) > chances[2]
    assert localizability(at(2.0), brick, camera, 2 * WIDTH_ERROR) < chances[2]


def test_a_score_is_no_higher_than_either_of_its_parts() -> None:
    result = TrackingResult(at(1.0), 3, StopReason.STOP_ACTION, 0.8, 1.0, localizability=0.5)
    assert result.score == pytest.approx(0.4)
    assert TrackingResult(None, 0, StopReason.FAILED, 0.0, 1.0, "lost").score == 0.0
