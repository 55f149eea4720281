"""The published errors (BOP, RBOT, Laval) against plain loops, SciPy and hand-made vectors."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from moveit6d.evaluation import metrics
from moveit6d.evaluation.metrics import pose_errors
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3, random_rotations
from moveit6d.geometry.symmetry import ContinuousSymmetry, Symmetries

K = torch.tensor([[500.0, 0, 320], [0, 510, 240], [0, 0, 1]], dtype=torch.float64)
IDENTITY = torch.eye(4, dtype=torch.float64)[None]


def some(count: int, seed: int = 3) -> tuple[Pose, Pose, torch.Tensor]:
    """Estimates near true poses, and points, about a metre before the camera."""
    generator = torch.Generator().manual_seed(seed)

    def noise(scale: float) -> torch.Tensor:
        return torch.randn(count, 3, dtype=torch.float64, generator=generator) * scale

    place = noise(0.1) + torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64)
    truth = Pose(random_rotations(count, generator), place)
    estimate = Pose(truth.rotation @ exp_so3(noise(0.2)), place + noise(0.02))
    points = torch.randn(40, 3, dtype=torch.float64, generator=generator) * 0.05
    return estimate, truth, points


def pixel(point: np.ndarray) -> tuple[float, float]:
    return 500 * point[0] / point[2] + 320, 510 * point[1] / point[2] + 240


def moved(pose: Pose, x: np.ndarray) -> np.ndarray:
    found: np.ndarray = pose.rotation.numpy() @ x + pose.translation.numpy()
    return found


def two_fold() -> torch.Tensor:
    """The identity and half a turn about an axis that does not go through the origin."""
    half = np.eye(4)
    half[0, 0] = half[1, 1] = -1
    half[0, 3] = 0.02
    return torch.from_numpy(Symmetries(half[None]).transforms())


def test_mssd_mspd_and_reprojection_agree_with_loops() -> None:
    estimate, truth, points = some(3)
    symmetries = two_fold()
    surface = metrics.mssd(estimate, truth, points, symmetries)
    image = metrics.mspd(estimate, truth, points, symmetries, K)
    mean = metrics.reprojection_error(estimate, truth, points, K)
    for k in range(3):
        far, wide = [], []
        for s in symmetries.numpy():
            pairs = [
                (moved(estimate[k], x), moved(truth[k], s[:3, :3] @ x + s[:3, 3]))
                for x in points.numpy()
            ]
            far.append(max(math.dist(a, b) for a, b in pairs))
            wide.append(max(math.dist(pixel(a), pixel(b)) for a, b in pairs))
        assert float(surface[k]) == pytest.approx(min(far), abs=1e-12)
        assert float(image[k]) == pytest.approx(min(wide), abs=1e-9)
        shifts = [
            math.dist(pixel(moved(estimate[k], x)), pixel(moved(truth[k], x)))
            for x in points.numpy()
        ]
        assert float(mean[k]) == pytest.approx(np.mean(shifts), abs=1e-9)


def test_many_points_in_several_chunks_change_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    estimate, truth, points = some(2)
    whole = metrics.mssd(estimate, truth, points, two_fold())
    monkeypatch.setattr(pose_errors, "CHUNK", 40)
    torch.testing.assert_close(metrics.mssd(estimate, truth, points, two_fold()), whole)


def test_the_truth_times_any_symmetry_has_no_mssd_and_no_mspd() -> None:
    axis = ContinuousSymmetry(np.array([0.0, 0.6, 0.8]), np.array([0.01, 0.0, 0.02]))
    half = np.diag([1.0, -1.0, -1.0, 1.0])
    symmetries = torch.from_numpy(Symmetries(half[None], (axis,)).transforms())
    assert len(symmetries) == 630  # 315 steps of the axis, with and without half a turn
    _, truth, points = some(1)
    truth = truth[0]
    for k in (0, 1, 200, 314, 315, 501, 629):
        estimate = truth @ Pose.from_matrix(symmetries[k])
        assert float(metrics.mssd(estimate, truth, points, symmetries)) < 1e-6
        assert float(metrics.mspd(estimate, truth, points, symmetries, K)) < 1e-6
        assert k == 0 or float(metrics.mssd(estimate, truth, points, IDENTITY)) > 1e-4


def test_a_point_in_the_plane_of_the_camera_is_infinitely_far() -> None:
    truth = Pose.identity()
    points = torch.tensor([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], dtype=torch.float64)
    assert math.isinf(float(metrics.mspd(truth, truth, points, IDENTITY, K)))
    assert float(metrics.mssd(truth, truth, points, IDENTITY)) == 0


def laval_by_scipy(found: np.ndarray, true: np.ndarray) -> float:
    """The authors' steps with another library's rotations."""
    vector = np.abs(Rotation.from_matrix(found @ true.T).as_rotvec())
    return float(np.degrees(Rotation.from_euler("XYZ", vector).magnitude()))


def test_the_official_rotation_error_of_laval() -> None:
    estimate, truth, _ = some(20)
    found = metrics.laval_rotation_error(estimate, truth)
    for k in range(20):
        expected = laval_by_scipy(estimate.rotation[k].numpy(), truth.rotation[k].numpy())
        assert float(found[k]) == pytest.approx(expected, abs=1e-9)


def test_the_official_error_is_not_the_angle() -> None:
    vector = torch.full((3,), math.radians(30), dtype=torch.float64)
    zero = torch.zeros(3, dtype=torch.float64)
    estimate, truth = Pose(exp_so3(vector), zero), Pose.identity()
    assert float(metrics.rotation_error(estimate, truth)) == pytest.approx(51.9615, abs=1e-4)
    # Trace of Rx Ry Rz at 30° each: 3/4 + (3/4 - 1/8) + 3/4.
    trace = 0.75 + 0.625 + 0.75
    official = math.degrees(math.acos((trace - 1) / 2))
    assert float(metrics.laval_rotation_error(estimate, truth)) == pytest.approx(official)
    about_x = Pose(exp_so3(torch.tensor([-0.5, 0, 0], dtype=torch.float64)), zero)
    assert float(metrics.laval_rotation_error(about_x, truth)) == pytest.approx(math.degrees(0.5))
    assert float(metrics.laval_rotation_error(truth, truth)) == 0  # and not NaN


def test_the_official_error_is_the_same_in_opengl_axes() -> None:
    estimate, truth, _ = some(5)
    flip = torch.tensor([1.0, -1.0, -1.0], dtype=torch.float64)[:, None]
    turned = [Pose(flip * pose.rotation, pose.translation) for pose in (estimate, truth)]
    torch.testing.assert_close(
        metrics.laval_rotation_error(*turned), metrics.laval_rotation_error(estimate, truth)
    )


def test_limits_of_5_cm_and_5_degrees() -> None:
    truth = Pose.identity(4)
    turn = torch.zeros(4, 3, dtype=torch.float64)
    turn[2, 1], turn[3, 1] = math.radians(4.999), math.radians(5.001)
    shift = torch.zeros(4, 3, dtype=torch.float64)
    shift[0, 0], shift[1, 0] = 0.05, 0.0501
    estimate = Pose(exp_so3(turn), shift)
    assert metrics.within(estimate, truth).tolist() == [True, False, True, False]
    strict = metrics.within(estimate, truth, strict=True)
    assert strict.tolist() == [False, False, True, False]
    assert metrics.within(estimate, truth, 0.02, 2).tolist() == [False] * 4


def test_stability_is_the_motion_between_frames() -> None:
    turns = torch.zeros(3, 3, dtype=torch.float64)
    turns[:, 2] = torch.tensor([0.0, 0.1, -0.1])
    places = torch.tensor([[0.0, 0, 1], [0, 0.003, 1], [0.004, 0, 1]], dtype=torch.float64)
    shift, turn = metrics.stability(Pose(exp_so3(turns), places))
    assert shift.tolist() == pytest.approx([0.003, 0.005])
    assert turn.tolist() == pytest.approx([math.degrees(0.1), math.degrees(0.2)])


def test_the_official_stability_goes_round_and_subtracts_rotation_vectors() -> None:
    _, poses, _ = some(4)
    shift, turn = metrics.laval_stability(poses)
    flip = np.diag([1.0, -1.0, -1.0])
    vectors = [Rotation.from_matrix(flip @ r).as_rotvec() for r in poses.rotation.numpy()]
    for k in range(4):
        after = (k + 1) % 4
        expected = math.dist(poses.translation[after], poses.translation[k])
        assert float(shift[k]) == pytest.approx(expected)
        angles = Rotation.from_euler("XYZ", vectors[after] - vectors[k])
        assert float(turn[k]) == pytest.approx(np.degrees(angles.magnitude()), abs=1e-9)


@pytest.mark.parametrize(
    ("bad", "failures"),
    [([], 0), (range(5, 12), 0), (range(5, 13), 1), (range(5, 21), 2), (range(40), 5)],
)
def test_laval_fails_at_the_eighth_bad_frame(bad: range | list[int], failures: int) -> None:
    shift, turn = torch.full((40,), 0.03), torch.full((40,), 20.0)
    assert metrics.laval_failures(shift, turn) == 0
    for far, limit in ((shift, 0.0301), (turn, 20.1)):
        errors = far.clone()
        errors[list(bad)] = limit
        pair = (errors, turn) if far is shift else (shift, errors)
        assert metrics.laval_failures(*pair) == failures
