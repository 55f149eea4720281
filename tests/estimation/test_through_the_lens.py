"""Images as a lens took them: tracked, refined and detected as without it, and in its time."""

from __future__ import annotations

import time
from typing import Any

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from moveit6d.config import SeedDetectorConfig
from moveit6d.estimation import PoseEstimator, PoseTracker, SeedDetector, tracker
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.policies import load_policy
from tests.support.pictures import CAMERA, picture

LENSES: list[tuple[tuple[float, ...], str]] = [
    ((-0.35, 0.15, 0.002, -0.001, -0.03), "opencv"),
    ((0.1, -0.05, 0.001, 0.002, 0.01, 0.2, 0.03, 0.01), "opencv"),
    ((-0.05, 0.02, -0.01, 0.002), "fisheye"),
]


def seen_through(image: NDArray[np.uint8], lens: tuple[float, ...], model: str) -> Any:
    """The pinhole image as the lens draws it, by OpenCV: black where the pinhole saw nothing."""
    height, width = image.shape[:2]
    matrix = CAMERA.matrix.numpy()
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    pixels = np.stack([x, y], -1).reshape(-1, 1, 2).astype(np.float64)
    module = cv2.fisheye if model == "fisheye" else cv2
    pinhole = module.undistortPoints(pixels, matrix, np.array(lens), P=matrix)
    place = pinhole.reshape(height, width, 2).astype(np.float32)
    return cv2.remap(image, place[..., 0], place[..., 1], cv2.INTER_CUBIC)


def truth() -> Pose:
    turn = cv2.Rodrigues(np.array([0.5, -0.6, 0.2]))[0]
    return Pose(torch.from_numpy(turn), torch.tensor([0.085, -0.07, 0.45]).double())


@pytest.mark.parametrize(("lens", "model"), LENSES)
def test_poses_are_those_of_the_image_without_the_lens(
    brick: Mesh, lens: tuple[float, ...], model: str
) -> None:
    there = truth()
    image = picture(brick, there).permute(1, 2, 0).numpy()
    camera = Camera.from_matrix(CAMERA.matrix, 256, 256, lens, model)  # type: ignore[arg-type]
    distorted = seen_through(image, lens, model)
    start = Pose(there.rotation, there.translation + torch.tensor([0.004, -0.003, 0.01]).double())
    policy = load_policy()
    found = []
    for view, pixels in ((camera, distorted), (CAMERA, image), (CAMERA, distorted)):
        follower = PoseTracker(brick, view, brick.outer(there), policy=policy)
        follower.calibrate(pixels)
        follower.reset(brick.outer(start))
        followed = follower.update(pixels).pose
        refined = PoseEstimator(brick, view, policy=policy).refine(pixels, brick.outer(start)).pose
        assert followed is not None and refined is not None
        shifts = [brick.inner(pose).translation - there.translation for pose in (followed, refined)]
        found.append([float(shift.norm()) for shift in shifts])
    lensed, straight, ignored = found
    assert max(lensed) < max(straight) + 0.0015 and max(lensed) < 0.006
    assert min(ignored) > max(lensed) + 0.001  # what it costs to leave the lens out


def test_detection_sees_the_image_without_the_lens(brick: Mesh) -> None:
    lens, model = LENSES[0]
    there = truth()
    distorted = seen_through(picture(brick, there).permute(1, 2, 0).numpy(), lens, model)
    camera = Camera.from_matrix(CAMERA.matrix, 256, 256, lens)
    seen: list[Camera] = []

    class Looking(SeedDetector):
        def seed(self, image: Any) -> Any:
            seen.append(image.camera)
            raise StopIteration

    with pytest.raises(StopIteration):
        Looking(brick, camera, config=SeedDetectorConfig((0.3,))).detect(distorted)
    assert seen == [camera.full_pinhole]


def test_milliseconds_hold_the_preparation_of_the_frame(
    brick: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    prepare = tracker.prepare_frame

    def slowly(image: Any, camera: Camera) -> Any:
        time.sleep(0.05)
        return prepare(image, camera)

    there = truth()
    image = picture(brick, there).permute(1, 2, 0).numpy()
    follower = PoseTracker(brick, CAMERA, brick.outer(there))
    monkeypatch.setattr(tracker, "prepare_frame", slowly)
    begin = time.perf_counter()
    result = follower.update(image)
    assert 50 < result.milliseconds <= (time.perf_counter() - begin) * 1e3


def test_python_uses_one_thread_and_gives_the_callers_back(brick: Mesh) -> None:
    seen: list[int] = []
    policy = load_policy()

    class Watching:
        mode, crop = policy.mode, policy.crop

        def predict(self, observation: Any, state: Any) -> Any:
            seen.append(torch.get_num_threads())
            return policy.predict(observation, state)

    there = truth()
    image = picture(brick, there).permute(1, 2, 0).numpy()
    before = torch.get_num_threads()
    torch.set_num_threads(2)
    try:
        for threads in (1, None):
            follower = PoseTracker(
                brick, CAMERA, brick.outer(there), policy=Watching(), threads=threads
            )
            follower.update(image)
            PoseEstimator(brick, CAMERA, policy=Watching(), threads=threads).refine(
                image, brick.outer(there)
            )
            assert set(seen) == {threads or 2} and torch.get_num_threads() == 2
            seen.clear()
    finally:
        torch.set_num_threads(before)
