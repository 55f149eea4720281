"""The tracker and the estimator: several objects, bad frames, wrong images."""

import numpy as np
import pytest
import torch

from moveit6d.actions import difference
from moveit6d.errors import InputError
from moveit6d.estimation import PoseEstimator, PoseTracker, StopReason
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.policies import MoveMode, OraclePolicy

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
GRAY = np.full((240, 320, 3), 90, np.uint8)


def at(x: float, z: float = 0.7) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([x, 0.0, z], dtype=torch.float64))


def test_every_frame_starts_where_the_last_one_ended(brick: Mesh) -> None:
    tracker = PoseTracker(
        brick, CAMERA, at(0.0), policy=OraclePolicy(Pose.stack([brick.inner(at(0.01))]))
    )
    first = tracker.update(GRAY)[0]
    second = tracker.update(GRAY)[0]
    assert first.steps > 3 and second.steps == 1
    assert first.pose is not None and second.pose is not None
    torch.testing.assert_close(second.pose.matrix(), first.pose.matrix())


def test_several_objects_in_one_batch(brick: Mesh) -> None:
    goals = [at(-0.05), at(0.02, 0.9), at(0.06, 0.6)]
    policy = OraclePolicy(Pose.stack([brick.inner(goal) for goal in goals]), MoveMode.ALL_AXES)
    tracker = PoseTracker([brick] * 3, CAMERA, [at(0.0), at(0.0), at(0.0)], policy=policy)
    for result, goal in zip(tracker.update(GRAY), goals, strict=True):
        assert result.pose is not None
        diameter = torch.tensor(brick.sphere_diameter, dtype=torch.float64)
        assert difference(brick.inner(result.pose), brick.inner(goal), diameter).abs().max() < 0.5


BAD = [
    (np.full((240, 320, 3), np.nan), "not finite"),
    (np.zeros((240, 320), np.uint8), "shape"),
    (np.zeros((240, 320, 4), np.uint8), "shape"),
    (np.zeros((480, 640, 3), np.uint8), "640×480"),
    (np.full((240, 320, 3), 200.0), r"\[0, 1\]"),
    (np.zeros((240, 320, 3), np.int64), "uint8"),
    ("picture.png", "array"),
]


@pytest.mark.parametrize(("image", "message"), BAD)
def test_an_estimator_refuses_images_that_do_not_fit(
    brick: Mesh, image: object, message: str
) -> None:
    estimator = PoseEstimator(brick, CAMERA, policy=OraclePolicy(Pose.stack([at(0.0)])))
    with pytest.raises(InputError, match=message):
        estimator.refine(image, at(0.0))


@pytest.mark.parametrize(("image", "message"), BAD)
def test_a_bad_frame_never_ends_a_track(brick: Mesh, image: object, message: str) -> None:
    policy = OraclePolicy(Pose.stack([brick.inner(at(0.004))]))
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy)
    failed = tracker.update(image)[0]
    assert failed.stopped_by is StopReason.FAILED and failed.pose is None
    assert failed.error is not None
    assert tracker.update(GRAY)[0].pose is not None


def test_floating_point_images_are_welcome(brick: Mesh) -> None:
    policy = OraclePolicy(Pose.stack([brick.inner(at(0.004))]))
    estimator = PoseEstimator(brick, CAMERA, policy=policy)
    assert estimator.refine(GRAY.astype(np.float32) / 255, at(0.0)).pose is not None


def test_lens_distortion_is_undone_first(brick: Mesh) -> None:
    lens = Camera(300, 300, 159.5, 119.5, 320, 240, (0.1, -0.05, 0.0, 0.0, 0.0))
    policy = OraclePolicy(Pose.stack([brick.inner(at(0.004))]))
    assert PoseEstimator(brick, lens, policy=policy).refine(GRAY, at(0.0)).pose is not None


def test_each_object_needs_its_start(brick: Mesh) -> None:
    with pytest.raises(InputError, match="2 meshes but 1 start"):
        PoseTracker([brick, brick], CAMERA, [at(0.0)], policy=OraclePolicy(Pose.stack([at(0.0)])))


def test_a_reset_starts_the_next_frame_from_the_given_pose(brick: Mesh) -> None:
    policy = OraclePolicy(Pose.stack([brick.inner(at(0.01))]))
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy)
    far = tracker.update(GRAY)[0].steps
    tracker.reset(at(0.01))
    assert tracker.update(GRAY)[0].steps == 1
    tracker.reset([at(0.0)])
    assert tracker.update(GRAY)[0].steps == far > 3


def test_a_reset_to_a_pose_out_of_sight_changes_nothing(brick: Mesh) -> None:
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=OraclePolicy(Pose.stack([at(0.0)])))
    for poses, message in ((at(5.0), "outside"), ([at(0.0), at(0.0)], "1 meshes but 2 start")):
        with pytest.raises(InputError, match=message):
            tracker.reset(poses)
        torch.testing.assert_close(tracker.poses[0].matrix(), at(0.0).matrix())
