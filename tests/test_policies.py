"""Policies: how predictions become actions, the oracle, folded networks."""

import dataclasses

import pytest
import torch

from moveit6d.actions import PoseAction, mirror_delta, pose_delta, rotate_delta
from moveit6d.errors import InputError
from moveit6d.frame import prepare_frame
from moveit6d.geometry.crop import Crop
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import random_rotations
from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.compact import CompactConfig, CompactCorrelationNet
from moveit6d.networks.correlation import CorrelationNet
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.observation import Observation, observe, rotated
from moveit6d.policies import (
    ActionMode,
    DihedralAugmentation,
    LoopState,
    NetworkPolicy,
    OraclePolicy,
    load_policy,
    search_policy,
    to_action,
)
from moveit6d.rendering import make_renderer
from tests.support import pictures
from tests.support.observations import an_observation


def a_prediction(best: int, delta: list[float] | None) -> PolicyOutput:
    logits = torch.zeros(1, 13)
    logits[0, best] = 5.0
    return PolicyOutput(logits, None if delta is None else torch.tensor([delta]), torch.ones(1))


def test_single_moves_follow_the_highest_score() -> None:
    action = to_action(a_prediction(9, [9.0] * 6), ActionMode.SINGLE, step_size=3.0)
    assert action.delta.tolist() == [[0, 0, 0, 0, -3, 0]] and not action.stop.any()
    assert to_action(a_prediction(12, None), ActionMode.SINGLE).stop.all()


def test_all_axes_move_at_once_and_stop_when_nothing_is_left() -> None:
    far = to_action(a_prediction(0, [3.5, 0, 0, 0, 0, -2]), ActionMode.ALL_AXES)
    assert far.delta.tolist() == [[3.5, 0, 0, 0, 0, -2]] and not far.stop.any()
    near = to_action(a_prediction(0, [0.2, 0, 0, 0, 0, 0.4]), ActionMode.ALL_AXES)
    assert near.stop.all() and near.delta[0, 5] == pytest.approx(0.4)
    assert to_action(a_prediction(12, [3.0] * 6), ActionMode.ALL_AXES).stop.all()
    small = a_prediction(0, [0.2, 0, 0, 0, 0, 0.4])
    assert not to_action(small, ActionMode.ALL_AXES, stop_delta=0.3).stop.any()
    assert to_action(small, ActionMode.ALL_AXES, step_size=2.0, stop_delta=0.3).stop.all()


def test_a_network_without_counts_cannot_move_all_axes() -> None:
    with pytest.raises(InputError, match="single"):
        to_action(a_prediction(0, None), ActionMode.ALL_AXES)
    assert NetworkPolicy(ActionNet()).mode is ActionMode.SINGLE


def test_the_oracle_knows_the_way() -> None:
    diameter = torch.full((2,), 0.2, dtype=torch.float64)
    place = torch.tensor([[0.0, 0, 1], [0.1, 0, 1]], dtype=torch.float64)
    truth = Pose(random_rotations(2, torch.Generator().manual_seed(0)), place)
    wanted = torch.tensor([[5.0, 0, 0, 0, 0, 0], [0, 0, 0, 0, -2.0, 0]], dtype=torch.float64)
    start = PoseAction.from_delta(-wanted).apply_centred(truth, diameter)
    prediction = OraclePolicy(truth).predict(
        an_observation(2), LoopState(start, diameter, torch.arange(2))
    )
    assert prediction.logits.argmax(-1).tolist() == [0, 9]
    torch.testing.assert_close(prediction.delta, pose_delta(start, truth, diameter))


def test_the_oracle_takes_plain_numbers_of_a_batch() -> None:
    truth = Pose(torch.eye(3)[None].requires_grad_(), torch.ones(1, 3))
    oracle = OraclePolicy(truth)
    assert oracle.truth.rotation.dtype == torch.float64 and not oracle.truth.rotation.requires_grad
    for wrong in (truth[0], truth.matrix):
        with pytest.raises(InputError, match="must be a batch of poses"):
            OraclePolicy(wrong)  # type: ignore[arg-type]


def test_in_a_mirror_the_counts_change_their_signs_as_poses_do() -> None:
    mirror = torch.diag(torch.tensor([-1.0, 1.0, 1.0]).double())

    def reflected(pose: Pose) -> Pose:  # a mirrored object at its mirrored place
        return Pose(mirror @ pose.rotation @ mirror, pose.translation @ mirror)

    generator = torch.Generator().manual_seed(3)
    rotation = random_rotations(20, generator).double()
    place = torch.rand(20, 3, generator=generator).double() * 0.1 + torch.tensor([0, 0, 0.7])
    pose, diameter = Pose(rotation, place), torch.full((20,), 0.15).double()
    delta = torch.randn(20, 6, generator=generator).double() * 4
    moved = PoseAction.from_delta(delta).apply_centred(pose, diameter)
    other = pose_delta(reflected(pose), reflected(moved), diameter)
    torch.testing.assert_close(other, mirror_delta(delta), atol=1e-6, rtol=1e-6)


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
    delta = torch.randn(20, 6, generator=generator).double() * 4
    moved = PoseAction.from_delta(delta).apply_centred(pose, diameter)
    other = pose_delta(rolled(pose), rolled(moved), diameter)
    torch.testing.assert_close(other, rotate_delta(delta, quarters), atol=1e-6, rtol=1e-6)


@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_turned_patches_show_what_turned_counts_say(quarters: int) -> None:
    """A dot at a pixel is at the turned place in the turned patch."""
    observation = an_observation(1)
    image = torch.zeros_like(observation.image)
    image[0, :, 20, 100] = 1.0
    shown = rotated(dataclasses.replace(observation, image=image), quarters)
    row, column = (int(n) for n in shown.image[0, 0].nonzero()[0])
    place = torch.tensor([[100 - 63.5, 20 - 63.5, 0, 0, 0, 0]])
    expected = rotate_delta(place, quarters)[0, :2]
    torch.testing.assert_close(torch.tensor([column - 63.5, row - 63.5]), expected)
    assert torch.equal(shown.mask, torch.rot90(observation.mask, quarters, (2, 3)))
    assert torch.equal(shown.distance, observation.distance)


class Lopsided:
    """Sees everything too far to the right in the picture it is shown, and where red is."""

    mode = ActionMode.ALL_AXES
    crop: Crop = "look_at"

    def predict(self, observation: Observation, state: LoopState) -> PolicyOutput:
        red, line = observation.image[:, 0], torch.arange(128.0) - 63.5
        x = (red * line).sum((1, 2)) / red.sum((1, 2))
        y = (red * line[:, None]).sum((1, 2)) / red.sum((1, 2))
        delta = torch.stack([x + 2.0, y, 0 * x + 1.0, -y, x + 1.0, 0 * x], 1)
        confidence = (x > 0).float()
        return PolicyOutput(torch.zeros(len(observation), 13), delta, confidence)


def test_what_is_wrong_on_one_side_cancels_in_all_ways_to_lay_it() -> None:
    observation = an_observation(2)
    image = torch.zeros_like(observation.image)
    image[0, :, 90, 70], image[1, :, 60, 50] = 1.0, 1.0
    observation = dataclasses.replace(observation, image=image)
    pose = Pose(torch.eye(3).double().expand(2, 3, 3), torch.tensor([[0, 0, 0.7]] * 2).double())
    state = LoopState(pose, torch.ones(2).double(), torch.arange(2))
    prediction = DihedralAugmentation(Lopsided()).predict(observation, state)
    assert prediction.delta is not None
    expected = [[6.5, 26.5, 1.0, -26.5, 6.5, 0.0], [-13.5, -3.5, 1.0, 3.5, -13.5, 0.0]]
    torch.testing.assert_close(prediction.delta, torch.tensor(expected))
    torch.testing.assert_close(prediction.confidence, torch.full((2,), 0.5))


def test_single_actions_are_not_turned() -> None:
    policy = NetworkPolicy(ActionNet())
    pose = Pose(torch.eye(3).double()[None], torch.tensor([[0, 0, 0.7]]).double())
    state = LoopState(pose, torch.ones(1).double(), torch.arange(1))
    prediction = DihedralAugmentation(policy).predict(an_observation(1), state)
    assert prediction.delta is None


def test_policies_of_the_same_weights_share_one_network() -> None:
    first, second = load_policy(), load_policy()
    assert first is not second and first.network is second.network
    assert load_policy(compute="float32").network is not load_policy(compute="bfloat16").network


def test_searches_have_the_confidence_that_was_fitted_for_them() -> None:
    seen = an_observation(1)
    pose = Pose(torch.eye(3).double()[None], torch.tensor([[0.0, 0, 1]], dtype=torch.float64))
    state = LoopState(pose, torch.ones(1), torch.zeros(1, dtype=torch.long))
    plain = NetworkPolicy(CompactCorrelationNet())
    assert search_policy(plain) is plain
    network = CompactCorrelationNet(CompactConfig(search_head=True))
    policy = NetworkPolicy(network, "name", compute="float32")
    searching = search_policy(policy)
    assert searching is search_policy(policy) is not policy
    assert isinstance(searching, NetworkPolicy) and searching.source == "name"
    with torch.no_grad():
        expected = network.for_search().eval()(seen).prediction
    found = searching.predict(seen, state)
    torch.testing.assert_close(found.confidence, expected.confidence, atol=1e-4, rtol=1e-4)
    torch.testing.assert_close(found.delta, policy.predict(seen, state).delta)


def test_compact_networks_answer_larger_crops_as_they_answer_the_usual_ones(brick: Mesh) -> None:
    policy, renderer = load_policy(compute="float32"), make_renderer()
    seen = Pose(torch.eye(3).double(), torch.tensor([0.002, -0.001, 0.5], dtype=torch.float64))
    image = pictures.picture(brick, seen).permute(1, 2, 0).numpy()
    frame = prepare_frame(image, pictures.CAMERA)
    start = Pose.stack([Pose(seen.rotation, seen.translation + torch.tensor([0.0, 0.001, 0.004]))])
    diameter = torch.tensor([brick.sphere_diameter / 1.6], dtype=torch.float64)
    state = LoopState(start, diameter, torch.zeros(1, dtype=torch.int64))
    usual, larger = (
        policy.predict(observe([frame], [brick], start, diameter, renderer, size=size), state)
        for size in (128, 192)
    )
    assert policy.takes_larger_crops
    truth = pose_delta(start, Pose.stack([seen]), diameter)
    assert usual.delta is not None and larger.delta is not None
    assert (usual.delta - truth).abs().max() < 1.5 and (larger.delta - truth).abs().max() < 1.5
    assert not NetworkPolicy(CorrelationNet()).takes_larger_crops
