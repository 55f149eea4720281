"""Policies: how decisions become moves, the oracle, folded networks."""

import pytest
import torch

from moveit6d.actions import PoseAction, difference
from moveit6d.errors import InputError
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import random_rotations
from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.decision import Decision
from moveit6d.policies import (
    MoveMode,
    NetworkPolicy,
    OraclePolicy,
    Situation,
    choose_move,
)
from tests.support.observations import an_observation


def a_decision(best: int, counts: list[float] | None) -> Decision:
    logits = torch.zeros(1, 13)
    logits[0, best] = 5.0
    return Decision(logits, None if counts is None else torch.tensor([counts]), torch.ones(1))


def test_single_moves_follow_the_highest_score() -> None:
    action = choose_move(a_decision(9, [9.0] * 6), MoveMode.SINGLE, step=3.0)
    assert action.counts.tolist() == [[0, 0, 0, 0, -3, 0]] and not action.stop.any()
    assert choose_move(a_decision(12, None), MoveMode.SINGLE).stop.all()


def test_all_axes_move_at_once_and_stop_when_nothing_is_left() -> None:
    far = choose_move(a_decision(0, [3.5, 0, 0, 0, 0, -2]), MoveMode.ALL_AXES)
    assert far.counts.tolist() == [[3.5, 0, 0, 0, 0, -2]] and not far.stop.any()
    near = choose_move(a_decision(0, [0.2, 0, 0, 0, 0, 0.4]), MoveMode.ALL_AXES)
    assert near.stop.all() and near.counts[0, 5] == pytest.approx(0.4)
    assert choose_move(a_decision(12, [3.0] * 6), MoveMode.ALL_AXES).stop.all()


def test_a_network_without_counts_cannot_move_all_axes() -> None:
    with pytest.raises(InputError, match="single"):
        choose_move(a_decision(0, None), MoveMode.ALL_AXES)
    with pytest.raises(InputError, match="single"):
        NetworkPolicy(ActionNet(), MoveMode.ALL_AXES)


def test_the_oracle_knows_the_way() -> None:
    diameter = torch.full((2,), 0.2, dtype=torch.float64)
    place = torch.tensor([[0.0, 0, 1], [0.1, 0, 1]], dtype=torch.float64)
    truth = Pose(random_rotations(2, torch.Generator().manual_seed(0)), place)
    wanted = torch.tensor([[5.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, -2.0, 0]], dtype=torch.float64)
    start = PoseAction.of(-wanted).apply(truth, diameter)
    decision = OraclePolicy(truth).decide(
        an_observation(2), Situation(start, diameter, torch.arange(2))
    )
    assert decision.logits.argmax(-1).tolist() == [0, 9]
    torch.testing.assert_close(decision.counts, difference(start, truth, diameter))
