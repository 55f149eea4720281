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
from moveit6d.observation import Observation, turned
from moveit6d.policies import (
    MoveMode,
    NetworkPolicy,
    OraclePolicy,
    Situation,
    TurnedPolicy,
    choose_move,
    turned_counts,
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
    signs = torch.tensor(TurnedPolicy.SIGNS).double()
    torch.testing.assert_close(other, counts * signs, atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize("quarters", [-1, 0, 1, 2, 3])
def test_under_a_camera_that_rolls_the_counts_turn_as_poses_do(quarters: int) -> None:
    # A pixel (x, y) comes to (y, -x): the world turns clockwise as x points right and y down.
    quarter = torch.tensor([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]]).double()
    roll = torch.linalg.matrix_power(quarter, quarters % 4)

    def rolled(pose: Pose) -> Pose:
        return Pose(roll @ pose.rotation, pose.translation @ roll.T)

    generator = torch.Generator().manual_seed(3)
    rotation = random_rotations(20, generator).double()
    place = torch.rand(20, 3, generator=generator).double() * 0.1 + torch.tensor([0, 0, 0.7])
    diameter = torch.full((20,), 0.15).double()
    # Straight ahead, where the look-at camera of the rolled pose is the rolled look-at camera.
    pose = Pose(rotation, torch.stack([0 * place[:, 0], 0 * place[:, 1], place[:, 2]], -1))
    counts = torch.randn(20, 6, generator=generator).double() * 4
    moved = PoseAction.of(counts).apply(pose, diameter)
    other = difference(rolled(pose), rolled(moved), diameter)
    torch.testing.assert_close(other, turned_counts(counts, quarters), atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_turned_patches_show_what_turned_counts_say(quarters: int) -> None:
    """A dot at a pixel is at the turned place in the turned patch."""
    seen = an_observation(1)
    image = torch.zeros_like(seen.image)
    image[0, :, 20, 100] = 1.0
    shown = turned(dataclasses.replace(seen, image=image), quarters)
    row, column = (int(n) for n in shown.image[0, 0].nonzero()[0])
    place = torch.tensor([[100 - 63.5, 20 - 63.5, 0, 0, 0, 0]])
    expected = turned_counts(place, quarters)[0, :2]
    torch.testing.assert_close(torch.tensor([column - 63.5, row - 63.5]), expected)
    assert torch.equal(shown.mask, torch.rot90(seen.mask, quarters, (2, 3)))
    assert torch.equal(shown.distance, seen.distance)


class Lopsided:
    """Sees everything too far to the right in the picture it is shown, and where red is."""

    mode = MoveMode.ALL_AXES
    crop: Crop = "look_at"

    def decide(self, seen: Observation, situation: Situation) -> Decision:
        red, line = seen.image[:, 0], torch.arange(128.0) - 63.5
        x = (red * line).sum((1, 2)) / red.sum((1, 2))
        y = (red * line[:, None]).sum((1, 2)) / red.sum((1, 2))
        counts = torch.stack([x + 2.0, y, 0 * x + 1.0, -y, x + 1.0, 0 * x], 1)
        confidence = (x > 0).float()
        return Decision(torch.zeros(len(seen), 13), counts, confidence)


def test_what_is_wrong_on_one_side_cancels_in_all_ways_to_lay_it() -> None:
    seen = an_observation(2)
    image = torch.zeros_like(seen.image)
    image[0, :, 90, 70], image[1, :, 60, 50] = 1.0, 1.0
    seen = dataclasses.replace(seen, image=image)
    pose = Pose(torch.eye(3).double().expand(2, 3, 3), torch.tensor([[0, 0, 0.7]] * 2).double())
    situation = Situation(pose, torch.ones(2).double(), torch.arange(2))
    decision = TurnedPolicy(Lopsided()).decide(seen, situation)
    assert decision.counts is not None
    expected = [[6.5, 26.5, 1.0, -26.5, 6.5, 0.0], [-13.5, -3.5, 1.0, 3.5, -13.5, 0.0]]
    torch.testing.assert_close(decision.counts, torch.tensor(expected))
    torch.testing.assert_close(decision.confidence, torch.full((2,), 0.5))


def test_single_actions_are_not_turned() -> None:
    policy = NetworkPolicy(ActionNet())
    pose = Pose(torch.eye(3).double()[None], torch.tensor([[0, 0, 0.7]]).double())
    situation = Situation(pose, torch.ones(1).double(), torch.arange(1))
    decision = TurnedPolicy(policy).decide(an_observation(1), situation)
    assert decision.counts is None
