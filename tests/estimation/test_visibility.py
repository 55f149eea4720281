"""What a camera cannot see is said in one sentence."""

from __future__ import annotations

import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.estimation.visibility import check_start, out_of_sight, start_problem
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)


def at(x: float, z: float) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([x, 0.0, z], dtype=torch.float64))


def test_an_object_is_seen_up_to_the_edge(brick: Mesh) -> None:
    reach = 0.5 * brick.sphere_diameter
    edge = 0.7 * (320 - CAMERA.cx) / 300 + reach  # the sphere touches the image
    for x, seen in ((edge - 1e-6, True), (edge + 1e-6, False)):
        found = out_of_sight(at(x, 0.7).translation, brick.sphere_diameter, CAMERA)
        assert (found is None) == seen
        pixel = CAMERA.project(at(x, 0.7).translation)  # the fast twin agrees with the camera
        assert seen or (found is not None and f"{float(pixel[0]):.0f}" in found)


@pytest.mark.parametrize(
    ("x", "z", "message"),
    [(0.0, -1.0, "behind"), (0.0, 0.01, "inside"), (5.0, 0.7, "outside"), (0.0, 99.0, "unit")],
)
def test_each_reason_is_said(brick: Mesh, x: float, z: float, message: str) -> None:
    problem = start_problem(at(x, z), brick, CAMERA)
    assert problem is not None and message in problem
    with pytest.raises(InputError, match=message):
        check_start(brick.outer(at(x, z)), brick, CAMERA)


def test_batches_and_numbers_that_are_none_are_refused(brick: Mesh) -> None:
    with pytest.raises(InputError, match="single one"):
        check_start(Pose.identity(2), brick, CAMERA)
    assert "not finite" in (start_problem(at(float("nan"), 1.0), brick, CAMERA) or "")
