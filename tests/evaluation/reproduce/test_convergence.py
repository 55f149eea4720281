"""The robustness test: starts as Eq. 3 says, and a policy that knows the truth comes back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
import torch

from moveit6d.actions import pose_delta
from moveit6d.config import ActionMode
from moveit6d.datasets.sequences import Sequence, read_sequences
from moveit6d.errors import InputError
from moveit6d.evaluation.reproduce.convergence import (
    ConvergenceTrial,
    Plan,
    Reading,
    deviate,
    frames_of,
    reproduction,
    run,
    share_of_frames,
    units,
)
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from moveit6d.rendering.backends import make_renderer
from tests.support.configs import limited

SIZE = 0.2
PLACE = Pose(torch.eye(3).double()[None], torch.tensor([[0.05, 0.02, 0.8]]).double())


@pytest.fixture
def video(make_sequence: Callable[..., Any]) -> Sequence:
    return read_sequences(make_sequence("easy_00", frames=4, still=True).folder)[0]


def oracle(video: Sequence, mode: ActionMode) -> OraclePolicy:
    inner = video.load_mesh().inner(video.start)
    return OraclePolicy(Pose.stack([inner] * 16), mode)


def test_the_two_readings_of_the_formula() -> None:
    assert units(45, Reading.FORMULA) == 270  # on each axis
    assert 6 * units(45, Reading.TOTAL) == 270  # on all six together
    assert units(0, Reading.FORMULA) == 0


def test_a_deviation_is_that_many_unit_actions() -> None:
    """One axis at a time the sum is exact; the signs say which way."""
    diameter = torch.tensor([SIZE], dtype=torch.float64)
    for axis, sign in ((0, 1.0), (1, -1.0), (3, 1.0), (5, -1.0)):
        signs = torch.zeros(1, 6).double()
        signs[0, axis] = sign
        moved = deviate(PLACE, signs, [7], SIZE)
        delta = pose_delta(PLACE, moved, diameter)[0]
        expected = 7 * signs[0]
        tolerance = 0.2 if axis < 2 else 1e-6  # the patch turns with the object
        torch.testing.assert_close(delta, expected, atol=tolerance, rtol=0.02)


def test_any_number_of_steps_away_stays_before_the_camera() -> None:
    """270 units of t_z at once would be behind infinity; one after the other they are not."""
    signs = torch.tensor([[0, 0, -1.0, 0, 0, 0], [0, 0, 1.0, 0, 0, 0]]).double()
    both = Pose(PLACE.rotation.expand(2, 3, 3), PLACE.translation.expand(2, 3))
    far, near = deviate(both, signs, [270, 20], SIZE).translation.norm(dim=-1).tolist()
    start = float(PLACE.translation.norm())
    b = 128 / 1.4
    assert far == pytest.approx(start * (b / (b - 1)) ** 270)
    assert near == pytest.approx(start * (b / (b + 1)) ** 20)


def test_a_start_that_is_not_moved_stays() -> None:
    both = Pose(PLACE.rotation.expand(2, 3, 3), PLACE.translation.expand(2, 3))
    moved = deviate(both, torch.ones(2, 6).double(), [0, 3], SIZE)
    assert torch.equal(moved.translation[0], PLACE.translation[0])
    assert not torch.equal(moved.translation[1], PLACE.translation[0])


def test_an_oracle_comes_back_and_needs_more_steps_from_farther(video: Sequence) -> None:
    plan = Plan(ms=(0, 6, 12), readings=(Reading.TOTAL,), frames=2, loop=limited(200, 3.0))
    trials = [
        trial
        for found in run(video, oracle(video, ActionMode.SINGLE), make_renderer(), plan)
        for trial in found
    ]
    assert len(trials) == 6 and all(trial.right for trial in trials)
    iterations = {m: [t.iterations for t in trials if t.m == m] for m in plan.ms}
    assert max(iterations[0]) == 1 and max(iterations[6]) < min(iterations[12])
    # Steps of three: six axes of m units each are 2 m actions.
    assert min(iterations[12]) >= 20 and max(iterations[12]) <= 40
    before = {m: min(t.before for t in trials if t.m == m) for m in plan.ms}
    assert before[0] < 1e-9 < before[6] < before[12]


def test_the_limit_of_steps_is_a_failure(video: Sequence) -> None:
    plan = Plan(ms=(12,), readings=(Reading.TOTAL,), frames=1, loop=limited(5, 3.0))
    policy = oracle(video, ActionMode.SINGLE)
    ((trial,),) = run(video, policy, make_renderer(), plan)
    assert trial.iterations == 5 and trial.after == float("inf") and not trial.right


def test_a_start_out_of_sight_is_not_run(video: Sequence) -> None:
    plan = Plan(ms=(45,), readings=(Reading.FORMULA,), frames=1)
    ((trial,),) = run(video, oracle(video, ActionMode.ALL_AXES), make_renderer(), plan)
    assert trial.iterations == 0 and trial.before == float("inf")


def test_frames_are_thinned_as_in_the_paper(video: Sequence) -> None:
    assert [share_of_frames(m) for m in (24, 25, 30, 31)] == [1.0, 0.25, 0.25, 0.1]
    assert frames_of(video, Plan()) == [0, 1, 2, 3]
    assert frames_of(video, Plan(frames=2)) == [0, 3]
    assert frames_of(replace(video, keyframes=frozenset({1, 9})), Plan()) == [1]
    with pytest.raises(InputError, match="no frame"):
        frames_of(replace(video, keyframes=frozenset()), Plan())
    with pytest.raises(InputError, match="0 or more"):
        Plan(ms=(-1,))


def test_the_table_has_the_stated_point_and_steps_of_the_right_ones_only() -> None:
    trials = [
        ConvergenceTrial(Reading.TOTAL, 12, 0, 0.7, 0.01, 30),
        ConvergenceTrial(Reading.TOTAL, 12, 1, 0.5, 0.4, 90),
        ConvergenceTrial(Reading.FORMULA, 12, 0, float("inf"), float("inf"), 0),
    ]
    table = reproduction(trials, "surrogate", {}).tables[0]
    rows = [dict(zip(table.head, row, strict=True)) for row in table.rows]
    assert rows[0]["reading"] == "formula" and rows[0]["ADD<10%d"] == 0.0
    assert rows[0]["start ADD % d"] is None and rows[0]["steps where right"] is None
    assert rows[1]["ADD<10%d"] == 50.0 and rows[1]["steps where right"] == 30.0
    assert rows[1]["start ADD % d"] == pytest.approx(60) and rows[1]["paper ADD<10%d"] == 73.8
