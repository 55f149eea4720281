"""Whole sequences without reset: what the tracker gets, what is written, what is scored."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image

from moveit6d.datasets.pose_files import PoseRow, read_poses, write_poses
from moveit6d.datasets.sequences import read_sequence, read_sequences
from moveit6d.errors import InputError
from moveit6d.estimation import PoseTracker, TrackingResult
from moveit6d.evaluation.benchmark import gather, run_sequence, score_results, score_track
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from moveit6d.rendering.backends import make_renderer

Make = Callable[..., Any]


class OracleTracker(PoseTracker):
    """A real tracker whose policy is shown the true pose of each frame."""

    made = 0

    def __init__(self, poses: list[Pose], mesh: Mesh, camera: Camera, start: Pose) -> None:
        type(self).made += 1
        self.truth = [mesh.inner(pose) for pose in poses]
        self.frames = 0
        self.oracle = OraclePolicy(Pose.stack(self.truth[:1]))
        super().__init__(mesh, camera, start, policy=self.oracle, renderer=make_renderer())

    def update(self, image: Any) -> tuple[TrackingResult, ...]:
        self.frames += 1
        self.oracle.truth = Pose.stack([self.truth[self.frames]])
        return super().update(image)


def test_the_loop_follows_the_truth_through_a_sequence(make_sequence: Make, tmp_path: Path) -> None:
    made = make_sequence(frames=5)
    (sequence,) = read_sequence(made.folder)
    trackers = []

    def make_tracker(mesh: Mesh, camera: Camera, start: Pose) -> PoseTracker:
        trackers.append(OracleTracker(made.poses, mesh, camera, start))
        return trackers[-1]

    path = tmp_path / "ours" / "easy_00.csv"
    rows = gather(sequence, run_sequence(sequence, make_tracker), path)
    assert sorted(rows) == [0, 1, 2, 3, 4] and trackers[0].frames == 4
    assert rows[0].milliseconds is None, "the first pose is given"
    found = score_track(sequence, rows)
    assert found is not None and found.below_5 == 1.0 and found.frames == 4
    written = read_poses(path)
    assert len(written) == 5 and written[0].pose is not None
    torch.testing.assert_close(written[0].pose.translation, made.poses[0].translation)
    assert path.read_text().splitlines()[0].startswith("frame,r11,r12")
    assert score_results([sequence], tmp_path / "ours")["easy_00"].below_10 == 1.0


@pytest.mark.parametrize("damage", ["wrong size", "no image"])
def test_a_first_frame_that_teaches_nothing_does_not_end_the_sequence(
    make_sequence: Make, damage: str
) -> None:
    made = make_sequence(frames=4)
    (sequence,) = read_sequence(made.folder)
    first = made.folder / "frames" / "000000.png"
    if damage == "wrong size":
        Image.new("RGB", (10, 10)).save(first)
    else:
        first.write_bytes(b"no picture")

    def make_tracker(mesh: Mesh, camera: Camera, start: Pose) -> PoseTracker:
        return OracleTracker(made.poses, mesh, camera, start)

    found = score_track(sequence, gather(sequence, run_sequence(sequence, make_tracker), None))
    assert found is not None and found.below_5 == 1.0 and found.frames == 3


def test_without_a_path_nothing_is_written(make_sequence: Make, tmp_path: Path) -> None:
    made = make_sequence(frames=2)
    (sequence,) = read_sequence(made.folder)
    before = sorted(tmp_path.rglob("*"))
    assert sorted(gather(sequence, [], None)) == [0]
    assert sorted(tmp_path.rglob("*")) == before


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
    assert score_results(alone, first.folder) == {}


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
