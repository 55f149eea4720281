"""What goes in and comes out changes its frame once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import torch

from moveit6d.estimation import StopReason, Target
from moveit6d.estimation.results import Refined, TrackingResult, starts_of
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
IMAGE = np.zeros((240, 320, 3), np.uint8)


def test_targets_that_share_an_image_share_a_frame(brick: Mesh) -> None:
    pose = Pose.from_rvec([0.1, 0.2, 0.3], [0.0, 0.0, 0.7])
    one, two, three = starts_of(
        [Target(image, CAMERA, brick, pose) for image in (IMAGE, IMAGE, IMAGE.copy())]
    )
    assert one.frame is two.frame and two.frame is not three.frame
    torch.testing.assert_close(brick.outer(one.centred).matrix, pose.matrix)


def test_a_result_is_in_the_frame_of_the_mesh_file(brick: Mesh) -> None:
    centred = Pose.from_rvec([0.1, 0.2, 0.3], [0.0, 0.0, 0.7])
    found = Refined(centred, 3, StopReason.STOP_ACTION, 0.8, 5.0, None, 0.5).result(brick)
    assert found.pose is not None and found.score == 0.4
    torch.testing.assert_close(found.pose.matrix, brick.outer(centred).matrix)
    lost = Refined(None, 3, StopReason.FAILED, 0.0, 5.0, "lost").result(brick)
    assert lost.pose is None and lost.error == "lost" and lost.score == 0.0


def test_a_result_says_how_likely_its_pose_is() -> None:
    pose = Pose(torch.eye(3, dtype=torch.float64), torch.ones(3, dtype=torch.float64))
    single = TrackingResult(pose, 3, StopReason.STOP_ACTION, 0.8, 1.0)
    tracked = replace(single, state_probability=0.6)
    assert (single.probability, tracked.probability, tracked.confidence) == (0.8, 0.6, 0.8)
    assert replace(tracked, pose=None).probability is None
