"""Scores of whole sequences: results in every form, what counts, and what cannot be scored."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
import trimesh

from moveit6d.datasets.pose_files import PoseRow, write_poses
from moveit6d.datasets.sequences import read_sequence, read_sequences
from moveit6d.errors import InputError
from moveit6d.evaluation.sequence_scores import (
    confidences,
    gaps,
    score_results,
    score_track,
    scored_truth,
)
from moveit6d.evaluation.track_files import read_tracks
from moveit6d.evaluation.track_scores import EvaluationPoints, frame_errors
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.symmetry import Symmetries
from tests.support.sequence_meshes import AXIS, far_from_origin

Make = Callable[..., Any]
POINTS = EvaluationPoints(torch.eye(3, dtype=torch.float64), 0.1)


def test_results_are_found_in_every_form(make_sequence: Make, tmp_path: Path) -> None:
    first, second = make_sequence("easy_00"), make_sequence("hard_00")
    sequences = read_sequences(first.folder.parent)
    rows = [PoseRow(frame, pose=pose) for frame, pose in enumerate(first.poses)]
    write_poses(tmp_path / "out" / "easy_00.csv", rows)
    write_poses(tmp_path / "out" / "hard_00" / "poses.csv", rows[:3])
    found = score_results(sequences, tmp_path / "out")
    assert found["easy_00"].below_10 == 1.0
    assert found["hard_00"].missing == 3 and found["hard_00"].until_lost == 3
    alone = read_sequence(second.folder)
    assert score_results(alone, tmp_path / "out" / "easy_00.csv")["hard_00"].below_10 == 1.0
    assert score_results(alone, first.folder / "frames") == {}


def test_one_file_is_no_result_for_several_sequences(make_sequence: Make, tmp_path: Path) -> None:
    made = make_sequence("easy_00")
    make_sequence("easy_01")
    with pytest.raises(InputError, match="is one track, but there are 2 sequences"):
        score_results(read_sequences(made.folder.parent), made.folder / "poses.csv")
    with pytest.raises(InputError, match="does not exist"):
        score_results([], tmp_path / "nowhere")


def test_a_single_true_pose_is_not_scored(make_sequence: Make) -> None:
    made = make_sequence(frames=1)
    (sequence,) = read_sequence(made.folder)
    assert score_track(sequence, {0: PoseRow(0, pose=made.poses[0])}) is None


@pytest.mark.parametrize("known", [range(2, 6), range(5, 6)])
def test_the_first_true_pose_counts_where_the_start_is_earlier(
    make_sequence: Make, known: range
) -> None:
    made = make_sequence(frames=6)
    poses = made.folder / "poses.csv"
    head, *lines = poses.read_text().splitlines()
    poses.write_text("\n".join([head, *(lines[k] for k in known)]))
    (sequence,) = read_sequence(made.folder)
    rows = {k: PoseRow(k, pose=pose) for k, pose in enumerate(made.poses)}
    found = score_track(sequence, rows)
    assert found is not None and found.frames == len(known) and found.below_5 == 1.0
    scored = [error.frame for error in frame_errors(rows, scored_truth(sequence, rows), POINTS)]
    assert scored == [*known] and gaps(sequence, rows) == []
    later = {k: PoseRow(k, f"{k:06d}.png", pose) for k, pose in enumerate(made.poses) if k > 0}
    assert score_track(sequence, later) == found, "and where a track begins before it"


def test_a_track_that_spins_about_a_declared_axis_is_right(
    make_sequence: Make, tmp_path: Path
) -> None:
    made = make_sequence("can")
    can = trimesh.creation.cylinder(0.03, 0.12, sections=48)
    can.apply_translation((0.03, -0.01, 0.02))
    can.visual.vertex_colors = (200, 40, 40, 255)
    can.export(made.folder / "mesh.ply")
    (axis,) = Symmetries.from_bop(AXIS).continuous
    spun = [
        pose @ Pose.from_matrix(torch.from_numpy(axis.turn(0.8 * frame)))
        for frame, pose in enumerate(made.poses)
    ]
    track = tmp_path / "can.csv"
    write_poses(track, [PoseRow(k, pose=pose, confidence=0.9) for k, pose in enumerate(spun)])
    plain = read_sequence(made.folder)
    assert score_results(plain, track)["can"].below_10 < 0.5
    (made.folder / "mesh.symmetry.json").write_text(json.dumps(AXIS))
    declared = read_sequence(made.folder)
    assert score_results(declared, track)["can"].below_5 == 1.0
    assert (
        confidences(read_tracks(declared, track))[1].all()
        and not confidences(read_tracks(plain, track))[1].all()
    )


def test_results_of_a_mesh_far_from_its_origin_are_scored(
    make_sequence: Make, tmp_path: Path
) -> None:
    made = make_sequence("easy_00")
    poses = far_from_origin(made.folder)
    assert Mesh.load(made.folder / "mesh.obj").center[0] > 499
    track = tmp_path / "easy_00.csv"
    write_poses(track, [PoseRow(k, pose=pose, confidence=0.9) for k, pose in enumerate(poses)])
    sequences = read_sequence(made.folder)
    assert score_results(sequences, track)["easy_00"].below_5 == 1.0
    assert confidences(read_tracks(sequences, track))[1].tolist() == [True] * 5
