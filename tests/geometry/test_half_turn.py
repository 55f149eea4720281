"""Half turns leave the box around an object as it is, and are what they are called."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from moveit6d.geometry.half_turn import half_turns


def cloud(kind: str, seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    points = random.uniform(-1, 1, (400, 3)) * [0.03, 0.08, 0.2]
    points = np.concatenate([points, np.array(np.meshgrid(*[[-1, 1]] * 3)).T.reshape(-1, 3)
                             * [0.03, 0.08, 0.2]])  # fmt: skip
    if kind == "flat":
        points[:, 0] = 0
    if kind == "cube":
        points = np.array(np.meshgrid(*[[-0.1, 0.1]] * 3)).T.reshape(-1, 3)
    turn = Rotation.random(random_state=seed).as_matrix()
    return np.asarray(points @ turn.T + random.normal(size=3))


@pytest.mark.parametrize("kind", ["box", "flat", "cube"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_the_corners_change_places(kind: str, seed: int) -> None:
    points = cloud(kind, seed)
    motions = half_turns(points)
    corners = points[-8:]
    for motion in motions:
        assert Rotation.from_matrix(motion[:3, :3]).magnitude() == pytest.approx(np.pi, abs=1e-6)
        moved = corners @ motion[:3, :3].T + motion[:3, 3]
        apart = np.linalg.norm(moved[:, None] - corners, axis=2)
        assert apart.min(1).max() < 1e-6
        assert (motion @ motion)[:3] == pytest.approx(np.eye(4)[:3], abs=1e-9)
    between = np.einsum("aij,bij->ab", motions[:, :3, :3], motions[:, :3, :3])
    assert between == pytest.approx(3 * np.eye(3) - (1 - np.eye(3)), abs=1e-6)


def test_they_are_the_same_each_time() -> None:
    points = cloud("box", 3)
    assert np.array_equal(half_turns(points), half_turns(points.copy()))
