"""The nearest equivalent pose against all of them, cut finely."""

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from moveit6d.geometry.equivalent import nearest_equivalent
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.symmetry import ContinuousSymmetry, Symmetries

FLIP = np.diag([1.0, -1.0, -1.0, 1.0])
AXIS = ContinuousSymmetry(np.array([0.0, 0.0, 1.0]), np.array([0.02, -0.01, 0.0]))


def a_pose(random: np.random.Generator) -> Pose:
    turn = Rotation.random(random_state=int(random.integers(1 << 30))).as_matrix()
    return Pose(torch.from_numpy(turn), torch.from_numpy(random.normal(size=3)))


def angle(one: Pose, other: Pose) -> float:
    between = one.rotation.mT @ other.rotation
    return float(Rotation.from_matrix(between.numpy()).magnitude())


@pytest.mark.parametrize(
    "symmetries",
    [Symmetries(FLIP[None]), Symmetries(continuous=(AXIS,)), Symmetries(FLIP[None], (AXIS,))],
)
def test_no_equivalent_is_nearer(symmetries: Symmetries) -> None:
    random = np.random.default_rng(0)
    motions = torch.from_numpy(symmetries.transforms(0.5))
    for _ in range(20):
        pose, reference = a_pose(random), a_pose(random)
        found = nearest_equivalent(pose, reference, symmetries)
        every = [Pose(pose.rotation @ m[:3, :3], pose.translation) for m in motions]
        least = min(angle(one, reference) for one in every)
        assert angle(found, reference) <= least + 1e-9
        assert angle(found, reference) >= least - np.radians(0.25)
        # It is one of them: the point that every motion of the axis keeps stays where it was.
        kept = torch.tensor([0.02, -0.01, 0.0], dtype=torch.float64)
        if not len(symmetries.discrete):
            torch.testing.assert_close(
                found.rotation @ kept + found.translation, pose.rotation @ kept + pose.translation
            )


def test_without_symmetry_a_pose_stays() -> None:
    pose = a_pose(np.random.default_rng(1))
    assert nearest_equivalent(pose, a_pose(np.random.default_rng(2)), Symmetries()) is pose
