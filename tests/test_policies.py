"""Policies: how decisions become moves, the oracle, folded networks."""

import dataclasses

import pytest
import torch

from moveit6d.actions import PoseAction, difference
from moveit6d.errors import InputError
from moveit6d.geometry.crop import Crop
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import random_rotations
from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.decision import Decision
from moveit6d.observation import Observation
from moveit6d.policies import (
    MirroredPolicy,
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


def test_in_a_mirror_the_counts_change_their_signs_as_poses_do() -> None:
    mirror = torch.diag(torch.tensor([-1.0, 1.0, 1.0]).double())

    def reflected(pose: Pose) -> Pose:  # a mirrored object at its mirrored place
        return Pose(mirror @ pose.rotation @ mirror, pose.translation @ mirror)

    generator = torch.Generator().manual_seed(3)
    rotation = random_rotations(20, generator).double()
    place = torch.rand(20, 3, generator=generator).double() * 0.1 + torch.tensor([0, 0, 0.7])
    pose, diameter = Pose(rotation, place), torch.full((20,), 0.15).double()
    counts = torch.randn(20, 6, generator=generator).double() * 4
    moved = PoseAction.of(counts).apply(pose, diameter)
    other = difference(reflected(pose), reflected(moved), diameter)
    signs = torch.tensor(MirroredPolicy.SIGNS).double()
    torch.testing.assert_close(other, counts * signs, atol=1e-6, rtol=1e-6)


class Lopsided:
    """Sees everything too far to the right in the picture, and the truth by where red is."""

    mode = MoveMode.ALL_AXES
    crop: Crop = "look_at"

    def decide(self, seen: Observation, situation: Situation) -> Decision:
        columns = seen.image[:, 0].mean(1)
        middle = (columns * torch.arange(128.0)).sum(1) / columns.sum(1) - 63.5
        zero = torch.zeros_like(middle)
        counts = torch.stack([middle + 2.0, zero, zero + 1.0, zero, middle, zero], 1)
        confidence = (middle > 0).float()
        return Decision(torch.zeros(len(seen), 13), counts, confidence)


def test_what_is_wrong_on_one_side_cancels_in_the_mirror() -> None:
    seen = an_observation(2)
    image = torch.zeros_like(seen.image)
    image[0, :, :, 70], image[1, :, :, 50] = 1.0, 1.0
    seen = dataclasses.replace(seen, image=image)
    pose = Pose(torch.eye(3).double().expand(2, 3, 3), torch.tensor([[0, 0, 0.7]] * 2).double())
    situation = Situation(pose, torch.ones(2).double(), torch.arange(2))
    decision = MirroredPolicy(Lopsided()).decide(seen, situation)
    assert decision.counts is not None
    torch.testing.assert_close(decision.counts[:, 0], torch.tensor([6.5, -13.5]))
    torch.testing.assert_close(decision.counts[:, 2], torch.ones(2))
    torch.testing.assert_close(decision.counts[:, 4], torch.tensor([6.5, -13.5]))
    torch.testing.assert_close(decision.confidence, torch.full((2,), 0.5))


def test_single_actions_are_not_mirrored() -> None:
    policy = NetworkPolicy(ActionNet())
    pose = Pose(torch.eye(3).double()[None], torch.tensor([[0, 0, 0.7]]).double())
    situation = Situation(pose, torch.ones(1).double(), torch.arange(1))
    decision = MirroredPolicy(policy).decide(an_observation(1), situation)
    assert decision.counts is None
