"""Starts that the camera cannot see are refused in one sentence."""

from __future__ import annotations

from dataclasses import replace

import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.estimation.visibility import check_start, start_problem
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)


def at(x: float, z: float) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([x, 0.0, z], dtype=torch.float64))


@pytest.mark.parametrize(
    ("x", "z", "message"),
    [(0.0, -1.0, "behind"), (0.0, 0.001, "inside"), (5.0, 0.7, "outside"), (0.0, 99.0, "unit")],
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


def test_only_where_the_object_stands_tells_of_millimetres(brick: Mesh) -> None:
    with pytest.raises(InputError, match=r"Start pose: the object stands 500 m.* millimetres"):
        check_start(at(10.0, 500.0), brick, CAMERA)
    far = replace(brick, center=brick.center + [200.0, 0.0, 0.0])
    check_start(far.outer(at(0.0, 0.5)), far, CAMERA)
    with pytest.raises(InputError, match="millimetres"):
        check_start(far.outer(at(10.0, 500.0)), far, CAMERA)
