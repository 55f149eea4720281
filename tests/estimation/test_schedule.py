"""Which starts go on, in which stage, and when each one ends."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from moveit6d.actions import PoseAction
from moveit6d.config import ActionMode, LoopConfig
from moveit6d.estimation.results import Start, StopReason
from moveit6d.estimation.schedule import Schedule
from moveit6d.frame import prepare_frame
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.crop import PADDING, PATCH_SIZE
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
FRAME = prepare_frame(np.zeros((240, 320, 3), np.uint8), CAMERA)


def at(x: float, z: float = 0.7) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([x, 0.0, z], dtype=torch.float64))


def starts(mesh: Mesh, *places: float, fine: bool = False) -> list[Start]:
    return [Start(FRAME, mesh, at(x), fine=fine) for x in places]


def advance(
    schedule: Schedule, mesh: Mesh, places: list[float], delta: float, confidence: list[float]
) -> None:
    """One iteration after which the active rows are at these places."""
    count = len(places)
    diameter = torch.full((count,), mesh.sphere_diameter, dtype=torch.float64)
    action = PoseAction.from_delta(torch.full((count, 6), delta))
    schedule.advance(
        Pose.stack([at(x) for x in places]), diameter, action, torch.tensor(confidence)
    )


def test_of_each_group_the_most_confident_first_iteration_goes_on(brick: Mesh) -> None:
    given = starts(brick, 0.0, 0.01, 0.02, 0.03)
    schedule = Schedule(given, LoopConfig(), ActionMode.ALL_AXES, [0, 0, 1, 1])
    advance(schedule, brick, [0.0, 0.01, 0.02, 0.03], 9.0, [0.2, 0.9, 0.4, 0.3])
    assert schedule.active.tolist() == [1, 2]
    advance(schedule, brick, [0.05, 0.06], 9.0, [0.5, 0.6])
    assert schedule.active.tolist() == [1, 2], "later iterations do not race"


def test_a_start_that_cannot_be_seen_loses_the_race_and_fails_if_it_is_alone(brick: Mesh) -> None:
    given = starts(brick, 9.0, 0.0, 9.0)
    schedule = Schedule(given, LoopConfig(max_iterations=1), ActionMode.ALL_AXES, [0, 0, 1])
    assert schedule.active.tolist() == [1]
    advance(schedule, brick, [0.0], 9.0, [0.1])
    found, failed = schedule.results()
    assert found.stopped_by is StopReason.MAX_ITERATIONS and found.centred is not None
    assert failed.centred is None and failed.error is not None and "outside" in failed.error
    alone = Schedule(starts(brick, 9.0, 9.0), LoopConfig(), ActionMode.SINGLE, [0, 0])
    assert len(alone.active) == 0 and len(alone.results()) == 1


@pytest.mark.parametrize(
    ("delta", "limit", "mode", "fine"),
    [
        (4.0, 8, ActionMode.ALL_AXES, True),  # the delta is small
        (9.0, 8, ActionMode.ALL_AXES, False),
        (9.0, 2, ActionMode.ALL_AXES, True),  # one iteration is left
        (4.0, 8, ActionMode.SINGLE, False),
    ],
)
def test_the_fine_stage_begins_near_the_object(
    brick: Mesh, delta: float, limit: int, mode: ActionMode, fine: bool
) -> None:
    loop = LoopConfig(max_iterations=limit, fine_scale=2.0)
    schedule = Schedule(starts(brick, 0.0), loop, mode, None)
    advance(schedule, brick, [0.01], delta, [0.5])
    assert bool(schedule.fine[0]) == fine and float(schedule.scale[0]) == (2.0 if fine else 1.0)


def test_a_pose_that_was_seen_before_ends_the_loop(brick: Mesh) -> None:
    unit = brick.sphere_diameter * PADDING / PATCH_SIZE  # metres that an action unit is across
    for limit, ended in ((0.5, True), (0.3, False)):
        loop = LoopConfig(fine_stage=False, revisit_delta=limit)
        schedule = Schedule(starts(brick, 0.0), loop, ActionMode.ALL_AXES, None)
        for x, confidence in ((0.0, 0.9), (0.02, 0.5), (0.4 * unit, 0.6)):
            advance(schedule, brick, [x], 9.0, [confidence])
        assert (len(schedule.active) == 0) == ended
        if ended:
            found = schedule.results()[0]
            assert found.stopped_by is StopReason.REVISITED and found.confidence > 0.8


@pytest.mark.parametrize(
    ("mode", "step_size", "ended"),
    [
        (ActionMode.SINGLE, 1.0, True),
        (ActionMode.SINGLE, 0.4, False),
        (ActionMode.SINGLE, 1.8, True),
        (ActionMode.ALL_AXES, 0.4, True),
    ],
)
def test_single_actions_come_again_by_their_length(
    brick: Mesh, mode: ActionMode, step_size: float, ended: bool
) -> None:
    unit = brick.sphere_diameter * PADDING / PATCH_SIZE
    loop = LoopConfig(fine_stage=False, step_size=step_size)
    schedule = Schedule(starts(brick, 0.0), loop, mode, None)
    for x in (0.0, 0.4 * unit):
        advance(schedule, brick, [x], 9.0, [0.5])
    assert (len(schedule.active) == 0) == ended


def test_without_the_fine_stage_no_start_is_in_it(brick: Mesh) -> None:
    given = starts(brick, 0.0, fine=True)
    assert bool(Schedule(given, LoopConfig(), ActionMode.ALL_AXES, None).fine[0])
    loop = LoopConfig(fine_stage=False)
    schedule = Schedule(given, loop, ActionMode.ALL_AXES, None)
    advance(schedule, brick, [0.01], 1.0, [0.5])
    assert not schedule.fine.any() and schedule.active.tolist() == [0]
