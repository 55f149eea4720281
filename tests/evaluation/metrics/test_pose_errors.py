"""Known answers: hand-made cases, plain loops, and the properties that the definitions promise."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from moveit6d.errors import InputError
from moveit6d.evaluation import metrics
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3, random_rotations


def pose(turn: tuple[float, float, float], place: tuple[float, float, float]) -> Pose:
    return Pose(
        exp_so3(torch.tensor(turn, dtype=torch.float64)),
        torch.tensor(place, dtype=torch.float64),
    )


def two_poses(count: int = 4) -> tuple[Pose, Pose, torch.Tensor]:
    generator = torch.Generator().manual_seed(3)
    points = torch.randn(50, 3, dtype=torch.float64, generator=generator) * 0.05
    turns = random_rotations(2 * count, generator)
    places = torch.randn(2 * count, 3, dtype=torch.float64, generator=generator) * 0.1
    return Pose(turns[:count], places[:count]), Pose(turns[count:], places[count:]), points


def test_add_is_the_mean_distance_of_the_moved_points() -> None:
    estimate, truth, points = two_poses()
    found = metrics.add(estimate, truth, points)
    for k in range(4):
        distances = []
        for x in points.numpy():
            a = estimate.rotation[k].numpy() @ x + estimate.translation[k].numpy()
            b = truth.rotation[k].numpy() @ x + truth.translation[k].numpy()
            distances.append(math.dist(a, b))
        assert float(found[k]) == pytest.approx(np.mean(distances), abs=1e-12)


def test_adi_looks_from_the_truth_for_the_nearest_estimate() -> None:
    estimate, truth, points = two_poses()
    found = metrics.adi(estimate, truth, points)
    for k in range(4):
        moved = estimate[k].transform(points).numpy()
        nearest = [min(math.dist(b, a) for a in moved) for b in truth[k].transform(points).numpy()]
        assert float(found[k]) == pytest.approx(np.mean(nearest), abs=1e-12)


def test_adi_from_the_estimate_to_the_truth_would_be_another_number() -> None:
    estimate, truth, points = two_poses()
    there, back = metrics.adi(estimate, truth, points), metrics.adi(truth, estimate, points)
    assert float((there - back).abs().min()) > 1e-4


def test_add_s_follows_the_declaration() -> None:
    estimate, truth, points = two_poses()
    torch.testing.assert_close(
        metrics.add_s(estimate, truth, points, symmetric=False),
        metrics.add(estimate, truth, points),
    )
    torch.testing.assert_close(
        metrics.add_s(estimate, truth, points, symmetric=True), metrics.adi(estimate, truth, points)
    )


def test_a_half_turn_of_a_symmetric_object_has_no_adi() -> None:
    corners = torch.tensor(
        [[x, y, z] for x in (-1.0, 1) for y in (-2.0, 2) for z in (-3.0, 3)], dtype=torch.float64
    )
    true, half = pose((0.1, 0.2, 0.3), (0, 0, 5)), pose((0, 0, math.pi), (0, 0, 0))
    assert float(metrics.adi(true @ half, true, corners)) == pytest.approx(0, abs=1e-12)
    assert float(metrics.add(true @ half, true, corners)) == pytest.approx(2 * math.sqrt(5))


def test_the_truth_has_no_error() -> None:
    _, truth, points = two_poses()
    for error in (
        metrics.add(truth, truth, points),
        metrics.adi(truth, truth, points),
        metrics.translation_error(truth, truth),
        metrics.rotation_error(truth, truth),
    ):
        assert error.shape == (4,) and float(error.abs().max()) < 1e-12


EYE = torch.eye(4, dtype=torch.float64)[None]
K = torch.tensor([[600.0, 0, 320], [0, 600, 240], [0, 0, 1]], dtype=torch.float64)
METRICS: dict[str, Callable[[Pose, Pose, Any], torch.Tensor]] = {
    "add": metrics.add,
    "adi": metrics.adi,
    "mssd": lambda a, b, x: metrics.mssd(a, b, x, EYE),
    "mspd": lambda a, b, x: metrics.mspd(a, b, x, EYE, K),
    "reprojection": lambda a, b, x: metrics.reprojection_error(a, b, x, K),
    "translation": lambda a, b, x: metrics.translation_error(a, b),
    "rotation": lambda a, b, x: metrics.rotation_error(a, b),
    "laval": lambda a, b, x: metrics.laval_rotation_error(a, b),
    "within": lambda a, b, x: metrics.within(a, b).double(),
    "errors_of": lambda a, b, x: metrics.errors_of(metrics.adi, a, b, x),
}


@pytest.mark.parametrize("name", METRICS)
def test_one_pose_is_compared_with_each_of_several(name: str) -> None:
    several, others, points = two_poses(3)
    error, one = METRICS[name], others[0]
    singles = torch.stack([error(several[k], one, points).reshape(()) for k in range(3)])
    torch.testing.assert_close(error(several, one, points), singles)
    singles = torch.stack([error(one, several[k], points).reshape(()) for k in range(3)])
    torch.testing.assert_close(error(one, several, points), singles)
    with pytest.raises(InputError, match=r"shape \(3,\) and true poses of shape \(2,\) do not fit"):
        error(several, others[:2], points)


@pytest.mark.parametrize("name", METRICS)
def test_points_and_poses_of_other_types_will_do(name: str) -> None:
    estimate, truth, points = two_poses()
    found = METRICS[name](estimate.to(torch.float32), truth, points.numpy())
    expected = METRICS[name](estimate, truth, points)
    torch.testing.assert_close(found, expected, rtol=1e-3, atol=1e-4)
    if name in ("add", "adi", "mssd", "mspd", "reprojection", "errors_of"):
        with pytest.raises(InputError, match="points must be"):
            METRICS[name](estimate, truth, points[:, :2])


def test_symmetries_and_intrinsics_may_be_arrays() -> None:
    estimate, truth, points = two_poses()
    found = metrics.mspd(estimate, truth, points, EYE.numpy(), K.numpy())  # type: ignore[arg-type]
    torch.testing.assert_close(found, metrics.mspd(estimate, truth, points, EYE, K))


def test_unbatched_poses_give_single_errors() -> None:
    a, b = pose((0, 0, 0.1), (0, 0, 1)), pose((0, 0, 0), (0.03, 0, 1.04))
    points = torch.zeros(3, 3, dtype=torch.float64)
    assert float(metrics.translation_error(a, b)) == pytest.approx(0.05)
    for error in (metrics.add(a, b, points), metrics.adi(a, b, points)):
        assert error.shape == () and float(error) == pytest.approx(0.05)
    assert float(metrics.rotation_error(a, b)) == pytest.approx(math.degrees(0.1))


@given(st.floats(1e-9, math.pi), st.integers(0, 100))
def test_the_rotation_error_is_the_angle(angle: float, seed: int) -> None:
    generator = torch.Generator().manual_seed(seed)
    axis = torch.nn.functional.normalize(
        torch.randn(3, dtype=torch.float64, generator=generator), dim=0
    )
    zero = torch.zeros(1, 3, dtype=torch.float64)
    start = Pose(random_rotations(1, generator), zero)
    end = Pose(start.rotation @ exp_so3(axis * angle), zero)
    found = float(metrics.rotation_error(start, end))
    assert found == pytest.approx(math.degrees(angle), rel=1e-6, abs=1e-10)
    assert float(metrics.rotation_error(end, start)) == pytest.approx(found, rel=1e-6, abs=1e-10)


def test_the_limit_itself_is_not_below_the_limit() -> None:
    errors = torch.tensor([0.0, 0.1, 0.05, math.inf], dtype=torch.float64)
    assert metrics.accuracy(errors, 0.1) == 0.5
    with pytest.raises(InputError, match="no error to count"):
        metrics.accuracy(torch.zeros(0), 0.1)


def lost_by_definition(good: list[bool], run: int) -> int:
    for k in range(len(good)):
        window = good[k : min(k + run, len(good))]
        if sum(window) == 0:
            return k + 1
    return len(good) + 1


@pytest.mark.parametrize(
    ("wrong", "lost"),
    [
        ([], 41),  # never wrong
        (range(10, 24), 41),  # 14 wrong frames in a row are not lost
        (range(10, 25), 11),  # 15 are, from the first of them
        (range(37, 40), 38),  # wrong to the end is lost, however few are left
        ([39], 40),
        ([0], 41),
        (range(40), 1),
    ],
)
def test_lost_is_15_wrong_frames_or_wrong_to_the_end(wrong: range | list[int], lost: int) -> None:
    errors = torch.zeros(40, dtype=torch.float64)
    errors[list(wrong)] = 1.0
    assert metrics.frames_until_lost(errors, 0.1) == lost


@given(st.lists(st.booleans(), max_size=60), st.integers(1, 20))
def test_lost_agrees_with_its_definition(good: list[bool], run: int) -> None:
    errors = torch.tensor([0.0 if right else 1.0 for right in good], dtype=torch.float64)
    assert metrics.frames_until_lost(errors, 0.5, run) == lost_by_definition(good, run)


@given(st.lists(st.tuples(st.sampled_from([0.1, 0.2, 0.5, 0.9]), st.booleans()), min_size=1))
def test_auroc_is_the_chance_of_the_right_order(cases: list[tuple[float, bool]]) -> None:
    right = [score for score, correct in cases if correct]
    wrong = [score for score, correct in cases if not correct]
    found = metrics.auroc(
        torch.tensor([score for score, _ in cases], dtype=torch.float64),
        torch.tensor([correct for _, correct in cases]),
    )
    if not right or not wrong:
        assert math.isnan(found)
        return
    wins = [1.0 if a > b else 0.5 if a == b else 0.0 for a in right for b in wrong]
    assert found == pytest.approx(sum(wins) / len(wins))
