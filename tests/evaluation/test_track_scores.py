"""Scores of tracks: hand-made cases, and the figures of the benchmark's own scorer."""

from __future__ import annotations

import importlib.util
import math
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pytest
import torch

from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.sequences import read_sequences
from moveit6d.errors import InputError
from moveit6d.evaluation.track_scores import (
    EvaluationPoints,
    Score,
    comparison_table,
    frame_errors,
    read_track,
    score,
    tracking_table,
)
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose

EYE = torch.eye(3, dtype=torch.float64)


def at(x: float) -> Pose:
    return Pose(EYE, torch.tensor([x, 0.0, 1.0], dtype=torch.float64))


@pytest.fixture
def surface() -> EvaluationPoints:
    """Any points; only translations are off here, so that ADD is their length."""
    return EvaluationPoints(torch.randn(20, 3, dtype=torch.float64), diameter=0.2)


def test_surface_points_lie_on_the_surface_in_the_files_frame(brick: Mesh) -> None:
    points = EvaluationPoints.of(brick).points
    low, high = points.amin(0), points.amax(0)
    # The brick's corners as the fixture makes them.
    expected = torch.tensor([[-0.03, -0.05, -0.005], [0.09, 0.03, 0.045]], dtype=torch.float64)
    torch.testing.assert_close(torch.stack([low, high]), expected, rtol=0, atol=1e-3)
    faces = (points - expected[0]).abs().minimum((points - expected[1]).abs()).amin(1)
    assert len(points) == 2000 and float(faces.max()) < 1e-6


def test_a_perfect_track_is_perfect(surface: EvaluationPoints) -> None:
    truth = {frame: at(0.01 * frame) for frame in range(30)}
    rows = {frame: PoseRow(frame, pose=pose) for frame, pose in truth.items()}
    found = score(rows, truth, surface)
    assert found == Score(29, 1.0, 1.0, 0.0, 0.0, 30, 1.0, 0, None, 0)
    assert found.never_lost


def test_the_figures_of_a_track_with_errors(surface: EvaluationPoints) -> None:
    truth = {frame: at(0.0) for frame in range(5)}
    rows = {
        0: PoseRow(0, pose=at(9.0)),  # given, never scored
        1: PoseRow(1, pose=at(0.0), milliseconds=10.0, iterations=2),
        2: PoseRow(2, pose=at(0.015), milliseconds=30.0, iterations=5),  # below 10 %, not 5 %
        3: PoseRow(3, pose=at(5.0), milliseconds=20.0, reset=True),  # cut at one diameter
        4: PoseRow(4),  # no pose
    }
    found = score(rows, truth, surface)
    assert (found.frames, found.below_10, found.below_5) == (4, 0.5, 0.25)
    assert found.mean_add == pytest.approx((0 + 0.015 + 0.2 + 0.2) / 4)
    assert found.median_add == pytest.approx((0.015 + 0.2) / 2)
    assert found.until_lost == 3 and not found.never_lost
    assert found.within_5cm_5deg == 0.5
    assert (found.resets, found.milliseconds, found.missing) == (1, 20.0, 1)
    assert found.iterations == 3.5


def test_a_symmetric_object_is_scored_by_add_s(brick: Mesh) -> None:
    half = Pose(torch.diag(torch.tensor([-1.0, -1, 1], dtype=torch.float64)), torch.zeros(3))
    middle = Pose(EYE, torch.from_numpy(brick.center))
    turned = at(0.0) @ middle @ half.to(torch.float64) @ middle.inverse()
    truth = {frame: at(0.0) for frame in range(3)}
    rows = {frame: PoseRow(frame, pose=turned) for frame in truth}
    assert score(rows, truth, EvaluationPoints.of(brick)).below_10 == 0
    assert score(rows, truth, EvaluationPoints.of(brick, symmetric=True)).below_10 == 1


def test_holes_in_the_truth_are_not_scored(surface: EvaluationPoints) -> None:
    truth = {0: at(0), 1: at(0), 7: at(0)}
    rows = {frame: PoseRow(frame, pose=at(1.0 if frame in (3, 4) else 0)) for frame in range(8)}
    assert [error.frame for error in frame_errors(rows, truth, surface)] == [1, 7]
    assert score(rows, truth, surface).below_10 == 1.0


def test_one_true_pose_cannot_be_scored(surface: EvaluationPoints) -> None:
    with pytest.raises(InputError, match="at least two frames"):
        score({}, {0: at(0)}, surface)


def some_score(share: float, median: float = 0.005, lost: int = 120) -> Score:
    return Score(119, share, share / 2, 0.01, median, lost, share, 0, 25.0, 0)


def test_the_table_averages_by_level_in_the_levels_order() -> None:
    names = ["hard_00", "easy_00", "easy_01", "fast_00"]
    values = [0.25, 1.0, 0.5, 0.75]
    medians = [0.001, 0.002, 0.004, 0.1]
    scores = {n: some_score(v, m) for n, v, m in zip(names, values, medians, strict=True)}
    levels = {name: name[:-3] for name in names}
    lines = [line.split("|")[1:-1] for line in tracking_table(scores, levels).splitlines()]
    cells = [[cell.strip() for cell in line] for line in lines]
    assert [row[0] for row in cells[2:]] == ["easy", "fast", "hard", "all"]
    assert cells[2][1:4] == ["2", "75.0 %", "37.5 %"] and cells[2][5] == "3.0"
    assert cells[5][1:3] == ["4", "62.5 %"] and cells[5][5] == "3.0", "median of medians"
    both = tracking_table(scores, levels, per_sequence=True)
    assert [line.split("|")[1].strip() for line in both.splitlines()][2:5] == [
        "easy",
        "easy_00",
        "easy_01",
    ]


def test_a_single_level_has_no_row_for_all() -> None:
    table = tracking_table({"clip": some_score(1.0)}, {"clip": "clip"}, per_sequence=True)
    assert len(table.splitlines()) == 3


def test_the_comparison_puts_trackers_beside_each_other() -> None:
    levels = {"easy_00": "easy", "hard_00": "hard"}
    ours = {"easy_00": some_score(1.0), "hard_00": some_score(0.5)}
    table = comparison_table({"rival": {"easy_00": some_score(0.9)}, "ours": ours}, levels)
    firsts = [
        tuple(cell.strip() for cell in line.split("|")[1:3]) for line in table.splitlines()[2:]
    ]
    assert firsts == [("easy", "rival"), ("easy", "ours"), ("hard", "ours"), ("all", "ours")]


def test_steps_have_a_column_where_a_track_counts_them() -> None:
    counted = {
        "a_0": replace(some_score(1.0), iterations=3.0),
        "a_1": replace(some_score(1.0), iterations=8),
    }
    levels = {"a_0": "a", "a_1": "a"}
    table = comparison_table({"rival": {"a_0": some_score(0.9)}, "ours": counted}, levels)
    head, _, *rows = [[cell.strip() for cell in line.split("|")] for line in table.splitlines()]
    column = head.index("iterations")
    assert [row[column] for row in rows] == ["-", "5.5"]
    assert "iterations" not in tracking_table({"a_0": some_score(0.9)}, levels)


@pytest.fixture(scope="module")
def reference(shared: Path) -> ModuleType:
    """The benchmark's own scorer, which knows nothing of this library."""
    file = shared / "bench" / "score_sequences.py"
    spec = importlib.util.spec_from_file_location("score_sequences", file)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("rival", ["m3t_region", "m3t_region_default_reset"])
def test_rivals_get_exactly_the_benchmarks_figures(
    shared: Path, reference: ModuleType, rival: str
) -> None:
    bench = shared / "bench"
    for sequence in read_sequences(bench / "sequences")[::3]:
        file = bench / "rivals" / rival / f"{sequence.name}.csv"
        surface = EvaluationPoints.of(Mesh.load(sequence.mesh, "m"))
        ours = score(read_track(file), sequence.truth, surface)
        theirs = reference.score(sequence.folder, file)
        assert (ours.frames, ours.until_lost) == (theirs["frames"], theirs["until_lost"])
        assert (ours.resets, ours.missing) == (theirs["resets"], theirs["missing"])
        assert ours.milliseconds == pytest.approx(theirs["ms"])
        assert 100 * ours.below_10 == pytest.approx(theirs["good"])
        assert 100 * ours.within_5cm_5deg == pytest.approx(theirs["within_5cm_5deg"])
        # The scorer works in float64 throughout, the mesh holds float32: below a micrometre.
        assert math.isclose(1000 * ours.mean_add, theirs["mean_add_mm"], abs_tol=1e-3)
        assert math.isclose(1000 * ours.median_add, theirs["median_add_mm"], abs_tol=1e-3)
        assert math.isclose(1000 * surface.diameter, theirs["diameter_mm"], abs_tol=1e-3)


def test_the_frame_of_the_loss_is_the_videos_number(surface: EvaluationPoints) -> None:
    truth = {frame: at(0.0) for frame in range(20, 200, 5)}
    rows = {k: PoseRow(k, pose=at(0.0 if k < 100 else 1.0)) for k in truth}
    found = score(rows, truth, surface)
    assert (found.until_lost, found.lost_at) == (16, 100)
    kept = {k: PoseRow(k, pose=at(0.0)) for k in truth}
    assert score(kept, truth, surface).lost_at is None
