"""A policy that is always off in depth is found out where the pose is known, and corrected."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import torch

from moveit6d.actions import pose_delta
from moveit6d.config import ActionMode, TrackerConfig
from moveit6d.estimation import PoseTracker
from moveit6d.estimation.calibration import depth_bias, seen_size
from moveit6d.estimation.results import Start
from moveit6d.frame import prepare_frame
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.crop import Crop
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.observation import Observation
from moveit6d.policies import LoopState, OraclePolicy
from moveit6d.rendering.backends import make_renderer
from tests.support.configs import NO_CONTOUR

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
GRAY = np.full((240, 320, 3), 90, np.uint8)
TRUTH = Pose(torch.eye(3).double(), torch.tensor([0.02, -0.01, 0.7], dtype=torch.float64))

CONFIG = TrackerConfig()


@dataclass
class TooNear:
    """Knows the one pose, but takes every object for so many units larger than it is."""

    pose: Pose
    bias: float
    scatter: float = 0.0
    mode: ActionMode = ActionMode.ALL_AXES
    crop: Crop = "look_at"

    def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
        """The exact delta with the bias."""
        number = len(state.target)
        oracle = OraclePolicy(Pose.stack([self.pose] * number), self.mode)
        same = replace(state, target=torch.arange(number))
        prediction = oracle.predict(seen, same)
        assert prediction.delta is not None
        delta = prediction.delta.clone()
        delta[:, 2] += self.bias + self.scatter * torch.linspace(-1, 1, number)
        return replace(prediction, delta=delta)


@dataclass
class Larger:
    """Sees an object of another size than its mesh, and follows it in depth by a part of that."""

    pose: Pose
    diameter: float  # that it sees, metres
    gain: float = 1.0
    mode: ActionMode = ActionMode.ALL_AXES
    crop: Crop = "look_at"

    def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
        """The delta to where a mesh of the size shown looks as large."""
        shown = state.sphere_diameter * CONFIG.loop.fine_scale / self.diameter
        places = self.pose.translation * (shown**self.gain)[:, None]
        poses = Pose(self.pose.rotation.expand(len(shown), 3, 3), places)
        same = replace(state, target=torch.arange(len(shown)))
        return OraclePolicy(poses, self.mode).predict(seen, same)


def left(mesh: Mesh, pose: Pose | None) -> float:
    """Counts t_z from a pose to the truth."""
    assert pose is not None
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    return float(pose_delta(mesh.inner(pose), TRUTH, diameter)[2])


@pytest.mark.parametrize("bias", [1.5, -0.8])
def test_the_bias_is_read_where_the_pose_is_known(brick: Mesh, bias: float) -> None:
    frame, policy = prepare_frame(GRAY, CAMERA), TooNear(TRUTH, bias)
    found = depth_bias(Start(frame, brick, TRUTH), policy, make_renderer(), CONFIG)
    assert found == pytest.approx(CONFIG.calibration.share * bias, abs=0.05)
    single = replace(policy, mode=ActionMode.SINGLE)
    assert depth_bias(Start(frame, brick, TRUTH), single, make_renderer(), CONFIG) == 0.0


def test_the_less_the_updates_agree_the_less_of_it_counts(brick: Mesh) -> None:
    frame, config = prepare_frame(GRAY, CAMERA), CONFIG.calibration
    deviation = float(torch.linspace(-1, 1, 2 * config.pairs).std(correction=0))
    for times, share in ((0.5, 0.8), (1.0, 0.5), (2.0, 0.2)):
        policy = TooNear(TRUTH, 1.2, scatter=times * config.disagreement / deviation)
        found = depth_bias(Start(frame, brick, TRUTH), policy, make_renderer(), CONFIG)
        assert found == pytest.approx(share * config.share * 1.2, abs=0.05)


def test_an_error_that_is_too_large_for_a_bias_is_limited(brick: Mesh) -> None:
    frame, policy = prepare_frame(GRAY, CAMERA), TooNear(TRUTH, -19.0)
    assert (
        depth_bias(Start(frame, brick, TRUTH), policy, make_renderer(), CONFIG)
        == -CONFIG.calibration.max_bias
    )


def test_an_object_that_just_looks_into_the_image_is_no_error(brick: Mesh) -> None:
    width, _, back = brick.vertices.max(0).tolist()  # its left back edge is the last to leave
    edge = (0.7 + back) * (CAMERA.width - 0.5 - CAMERA.cx) / CAMERA.fx + width
    place = torch.tensor([edge - 1e-4, 0.0, 0.7], dtype=torch.float64)
    pose = Pose(torch.eye(3).double(), place)
    frame, policy = prepare_frame(GRAY, CAMERA), TooNear(pose, 1.0)
    found = depth_bias(Start(frame, brick, pose), policy, make_renderer(), CONFIG)
    assert found == pytest.approx(CONFIG.calibration.share, abs=0.1)


@pytest.mark.parametrize(("size", "gain"), [(1.03, 1.0), (1.03, 0.6), (0.97, 0.6), (1.0, 0.8)])
def test_the_size_is_read_where_the_pose_is_known(brick: Mesh, size: float, gain: float) -> None:
    frame, policy = prepare_frame(GRAY, CAMERA), Larger(TRUTH, size * brick.sphere_diameter, gain)
    found = seen_size(Start(frame, brick, TRUTH), policy, make_renderer(), CONFIG)
    assert found == pytest.approx(size**CONFIG.calibration.size_share, abs=0.001)
    single = replace(policy, mode=ActionMode.SINGLE)
    assert seen_size(Start(frame, brick, TRUTH), single, make_renderer(), CONFIG) == 1.0


def test_a_size_is_limited_and_not_read_from_a_depth_that_does_not_go_by_it(brick: Mesh) -> None:
    start, renderer = Start(prepare_frame(GRAY, CAMERA), brick, TRUTH), make_renderer()
    large = Larger(TRUTH, 1.2 * brick.sphere_diameter)
    most = (1 + CONFIG.calibration.max_size) ** CONFIG.calibration.size_share
    assert seen_size(start, large, renderer, CONFIG) == pytest.approx(most, abs=0.001)
    deaf = Larger(TRUTH, 1.03 * brick.sphere_diameter, gain=0.2)
    assert seen_size(start, deaf, renderer, CONFIG) == 1.0
    assert seen_size(start, TooNear(TRUTH, 1.5), renderer, CONFIG) == 1.0


def test_a_tracker_that_has_seen_the_size_is_right_about_the_depth(brick: Mesh) -> None:
    policy = Larger(TRUTH, 1.04 * brick.sphere_diameter, 0.6)
    for learns, limit in ((False, 2.5), (True, 0.4)):
        tracker = PoseTracker(brick, CAMERA, brick.outer(TRUTH), policy=policy, config=NO_CONTOUR)
        if learns:
            for _ in range(2):  # the second time from the mesh as it was given, too
                tracker.calibrate(GRAY)
        for _ in range(2):
            result = tracker.update(GRAY)
        off = abs(left(brick, result.pose))
        assert off < limit and (learns or off > 1.5)
        assert tracker.meshes == [brick]


@pytest.mark.parametrize("target", [0, 1])
def test_every_row_is_of_the_target_that_is_calibrated(brick: Mesh, target: int) -> None:
    far = Pose(TRUTH.rotation, 1.02 * TRUTH.translation)
    policy = OraclePolicy(Pose.stack([*([far] * target), TRUTH]), ActionMode.ALL_AXES)
    frame = prepare_frame(GRAY, CAMERA)
    found = depth_bias(Start(frame, brick, TRUTH), policy, make_renderer(), CONFIG, target)
    assert found == pytest.approx(0, abs=0.01), "the policy makes no error"


def test_a_tracker_with_the_oracle_can_be_calibrated(brick: Mesh) -> None:
    policy = OraclePolicy(Pose.stack([TRUTH]), ActionMode.ALL_AXES)
    tracker = PoseTracker(brick, CAMERA, brick.outer(TRUTH), policy=policy, config=NO_CONTOUR)
    tracker.calibrate(GRAY)
    assert tracker.tracks[0].depth_bias == pytest.approx(0, abs=0.01)


def test_a_tracker_that_has_learnt_does_without_most_of_it(brick: Mesh) -> None:
    policy = TooNear(TRUTH, 1.5)
    for learns, expected in ((False, -1.5), (True, (CONFIG.calibration.share - 1) * 1.5)):
        tracker = PoseTracker(brick, CAMERA, brick.outer(TRUTH), policy=policy, config=NO_CONTOUR)
        if learns:
            tracker.calibrate(GRAY)
        for _ in range(2):
            result = tracker.update(GRAY)
        assert left(brick, result.pose) == pytest.approx(expected, abs=0.1)
