"""Motion costs iterations; a still object costs one a frame."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from moveit6d import load_policy, make_renderer
from moveit6d.config import CalibrationConfig, TrackerConfig
from moveit6d.estimation import PoseTracker
from moveit6d.evaluation.motion_cost import MotionCost, motion_costs, motion_table
from moveit6d.synthesis.objects.demo_object import demo_object


def test_a_still_object_costs_one_iteration_and_a_fast_one_more() -> None:
    still, fast = motion_costs(demo_object(), [0.0, 20.0], 8, load_policy(), make_renderer(), 0)
    assert still.iterations <= 1.34 < fast.iterations + 0.34 and still.still >= 2 / 3
    assert fast.iterations > still.iterations


def test_only_a_tracker_that_is_to_calibrate_does(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[bool] = []
    monkeypatch.setattr(PoseTracker, "calibrate", lambda self, image: seen.append(True))
    tools = load_policy(), make_renderer()
    for enabled in (False, True):
        config = TrackerConfig(calibration=CalibrationConfig(enabled=enabled))
        list(motion_costs(demo_object(), [0.0], 2, *tools, 0, config))
        assert len(seen) == enabled


def test_it_takes_as_many_threads_as_asked(monkeypatch: pytest.MonkeyPatch) -> None:
    seen: set[int] = set()
    update = PoseTracker._update

    def counting(self: PoseTracker[Any], image: Any) -> Any:
        seen.add(torch.get_num_threads())
        return update(self, image)

    monkeypatch.setattr(PoseTracker, "_update", counting)
    list(motion_costs(demo_object(), [0.0], 2, load_policy(), make_renderer(), 0, threads=2))
    assert seen == {2}


def test_the_table_has_a_line_a_speed() -> None:
    text = motion_table([MotionCost(0.0, 1.0, 12.0, 1.0), MotionCost(5.0, 1.5, 20.0, 0.5)])
    rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in text.splitlines()[2:]]
    assert rows == [["0", "1.00", "100 %", "12"], ["5", "1.50", "50 %", "20"]]
