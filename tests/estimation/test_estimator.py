"""Single images: what fits the camera is refined, what does not is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.config import ActionMode, LoopConfig, MultiStartConfig, TrackerConfig
from moveit6d.errors import InputError
from moveit6d.estimation import PoseEstimator, Target, refine_single
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.observation import Observation
from moveit6d.policies import LoopState, NetworkPolicy, OraclePolicy
from moveit6d.rendering.backends import make_renderer

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
GRAY = np.full((240, 320, 3), 128, np.uint8)
START = Pose(torch.eye(3).double(), torch.tensor([0.0, 0.0, 0.7], dtype=torch.float64))
TRUTH = Pose(torch.eye(3).double(), torch.tensor([0.004, 0.0, 0.7], dtype=torch.float64))


def estimator(mesh: Mesh, camera: Camera = CAMERA, augment: bool = True) -> PoseEstimator:
    policy = OraclePolicy(Pose.stack([mesh.inner(TRUTH)]), ActionMode.ALL_AXES)
    config = TrackerConfig(loop=LoopConfig(augment=augment))
    return PoseEstimator(mesh, camera, policy=policy, config=config)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        (np.zeros((240, 320, 3), np.uint16), "uint16"),
        (np.zeros((480, 640, 3), np.uint8), "640×480"),
        (np.full((240, 320, 3), 200.0), r"\[0, 1\]"),
        ("picture.png", "array"),
    ],
)
def test_images_that_do_not_fit_are_refused(brick: Mesh, image: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        estimator(brick).refine(image, START)  # type: ignore[arg-type]


def test_a_start_out_of_sight_is_refused(brick: Mesh) -> None:
    behind = Pose(START.rotation, -START.translation)
    with pytest.raises(InputError, match="behind the camera"):
        estimator(brick).refine(GRAY, behind)


@pytest.mark.parametrize(
    ("image", "camera"),
    [
        (GRAY, CAMERA),
        (GRAY.astype(np.float32) / 255, CAMERA),
        (GRAY, Camera(300, 300, 159.5, 119.5, 320, 240, (0.1, -0.05, 0.0, 0.0, 0.0))),
    ],
)
def test_bytes_floats_and_lenses_lead_to_the_truth(
    brick: Mesh, image: np.ndarray, camera: Camera
) -> None:
    found = estimator(brick, camera).refine(image, START)
    assert found.pose is not None
    assert float((found.pose.translation - TRUTH.translation).norm()) < 0.001


def test_augmentation_is_one_more_iteration(brick: Mesh) -> None:
    without, with_it = (estimator(brick, augment=a).refine(GRAY, START) for a in (False, True))
    assert with_it.iterations == without.iterations + 1


def test_networks_see_all_of_the_object_in_it_and_other_policies_their_usual_crops(
    brick: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    sizes: list[int] = []
    for kind in (NetworkPolicy, OraclePolicy):

        def watched(
            self: Any, seen: Observation, state: LoopState, plain: Any = kind.predict
        ) -> Any:
            sizes.append(seen.mask.shape[-1])
            return plain(self, seen, state)

        monkeypatch.setattr(kind, "predict", watched)
    estimator(brick).refine(GRAY, START)
    assert set(sizes) == {128}
    sizes.clear()
    config = TrackerConfig(multi_start=MultiStartConfig(enabled=False))
    PoseEstimator(brick, CAMERA, config=config).refine(GRAY, START)
    # The loop and the confidence of eight views, the same views, the confidence for searches.
    assert sizes == [128] * (len(sizes) - 9) + [192] * 8 + [128]


def test_what_cannot_be_seen_does_not_change_which_target_another_is(brick: Mesh) -> None:
    behind = Pose(START.rotation, -START.translation)
    other = Pose(TRUTH.rotation, torch.tensor([-0.01, 0.01, 0.72], dtype=torch.float64))
    policy = OraclePolicy(Pose.stack([brick.inner(other), brick.inner(TRUTH)]), ActionMode.ALL_AXES)
    targets = [Target(GRAY, CAMERA, brick, pose) for pose in (behind, START)]
    failed, found = refine_single(targets, policy=policy, renderer=make_renderer())
    assert failed.pose is None and found.pose is not None
    assert float((found.pose.translation - TRUTH.translation).norm()) < 0.001
