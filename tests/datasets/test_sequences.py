"""Sequence folders: what is found, the start without the truth, holes, several objects."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from moveit6d.datasets.pose_files import PoseRow, read_poses, write_poses
from moveit6d.datasets.sequences import Sequence, read_sequence, read_sequences
from moveit6d.datasets.video import open_frames
from moveit6d.errors import InputError
from moveit6d.geometry.pose import Pose
from tests.support.sequence_meshes import AXIS, far_from_origin

Make = Callable[..., Any]


def test_a_sequence_is_read_whole(make_sequence: Make) -> None:
    made = make_sequence("fast_03", frames=4)
    (found,) = read_sequence(made.folder)
    assert (found.name, found.level, found.first) == ("fast_03", "fast", 0)
    assert found.camera == made.camera and found.mesh == made.folder / "mesh.ply"
    assert list(found.truth) == [0, 1, 2, 3]
    for frame, pose in found.truth.items():
        torch.testing.assert_close(pose.matrix, made.poses[frame].matrix, rtol=0, atol=1e-9)
    assert open_frames(found.frames).length == 4


def test_a_sequence_knows_the_files_that_it_is_read_from(make_sequence: Make) -> None:
    folder = make_sequence("clip", frames=2).folder
    (found,) = read_sequence(folder)
    assert {path for path in found.files if path.is_file()} == {
        *filter(Path.is_file, folder.rglob("*"))
    }


def test_the_start_file_wins_over_the_truth(make_sequence: Make) -> None:
    made = make_sequence()
    other = Pose(made.poses[0].rotation, made.poses[0].translation + 0.01)
    other.save(made.folder / "start.json")
    (found,) = read_sequence(made.folder)
    assert torch.equal(found.start.translation, other.translation)
    torch.testing.assert_close(found.truth[0].translation, made.poses[0].translation)


def test_without_a_start_file_the_first_true_pose_starts(make_sequence: Make) -> None:
    made = make_sequence(start=False)
    rows = read_poses(made.folder / "poses.csv")
    write_poses(made.folder / "poses.csv", rows[2:])
    (found,) = read_sequence(made.folder)
    assert found.first == 2 and list(found.truth) == [2, 3, 4, 5]
    torch.testing.assert_close(found.start.translation, made.poses[2].translation)


def test_rows_belong_to_their_image_not_to_their_number(make_sequence: Make) -> None:
    made = make_sequence()
    rows = [PoseRow(r.frame + 100, r.image, r.pose) for r in read_poses(made.folder / "poses.csv")]
    del rows[3]
    write_poses(made.folder / "poses.csv", rows)
    (found,) = read_sequence(made.folder)
    assert list(found.truth) == [0, 1, 2, 4, 5]


def test_a_hole_is_not_truth(make_sequence: Make) -> None:
    made = make_sequence()
    rows = read_poses(made.folder / "poses.csv")
    rows[2] = PoseRow(2, rows[2].image)
    write_poses(made.folder / "poses.csv", rows)
    assert list(read_sequence(made.folder)[0].truth) == [0, 1, 3, 4, 5]


def test_several_objects_are_several_sequences(make_sequence: Make) -> None:
    made = make_sequence("table")
    columns = (
        "frame",
        "image",
        "object",
        *(f"r{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)),
        "tx",
        "ty",
        "tz",
    )
    rows = [
        PoseRow(r.frame, r.image, r.pose, object=name)
        for r in read_poses(made.folder / "poses.csv")
        for name in ("cup", "plate")
    ]
    write_poses(made.folder / "poses.csv", rows, columns)
    for name in ("cup", "plate"):
        shutil.copy(made.folder / "mesh.ply", made.folder / f"{name}.ply")
    cup, plate = read_sequences(made.folder)
    assert (cup.name, plate.name) == ("table.cup", "table.plate")
    assert plate.mesh.name == "plate.ply" and len(cup.truth) == 6


def test_declared_symmetries_make_a_sequence_symmetric(make_sequence: Make) -> None:
    made = make_sequence()
    assert not read_sequence(made.folder)[0].symmetric
    (made.folder / "mesh.symmetry.json").write_text(json.dumps(AXIS))
    assert read_sequence(made.folder)[0].symmetric


def test_poses_of_a_mesh_far_from_its_origin_are_read(make_sequence: Make) -> None:
    made = make_sequence()
    poses = far_from_origin(made.folder)
    (found,) = read_sequence(made.folder)
    assert float(found.load_mesh().center[0]) == pytest.approx(500.03, abs=1e-3)
    for frame, pose in found.truth.items():
        assert pose.translation[0] < -400
        torch.testing.assert_close(pose.matrix, poses[frame].matrix, rtol=0, atol=1e-6)
    rows = read_poses(made.folder / "poses.csv", center=found.load_mesh().center)
    wrong = [PoseRow(r.frame, r.image, Pose(p.rotation, 1000 * p.translation))
             for r, p in zip(rows, made.poses, strict=True)]  # fmt: skip
    write_poses(made.folder / "poses.csv", wrong)
    with pytest.raises(InputError, match="looks like millimetres"):
        read_sequence(made.folder)


def test_a_folder_of_sequences_is_searched(make_sequence: Make) -> None:
    root = make_sequence("hard_01").folder.parent
    make_sequence("easy_00")
    (root / "notes").mkdir()
    (root / "README.md").write_text("text")
    assert [sequence.name for sequence in read_sequences(root)] == ["easy_00", "hard_01"]


def test_levels_are_names_without_their_number() -> None:
    def level(name: str) -> str:
        here = Path()
        return Sequence(name, here, here, here, None, None, 0, {}).level  # type: ignore[arg-type]

    assert level("occ_02") == "occ"
    assert level("visp_mbt_cube") == "visp_mbt_cube"
    assert level("clip") == "clip"


def test_what_is_missing_is_said(make_sequence: Make, tmp_path: Path) -> None:
    made = make_sequence()
    (made.folder / "mesh.ply").unlink()
    with pytest.raises(InputError, match=r"holds no mesh; looked for mesh\.glb"):
        read_sequences(made.folder)
    (made.folder / "camera.json").unlink()
    with pytest.raises(InputError, match=r"holds no sequence: .*camera\.json"):
        read_sequences(made.folder)
    with pytest.raises(InputError, match="is not a folder"):
        read_sequences(tmp_path / "nowhere")


def test_an_unknown_image_is_said(make_sequence: Make) -> None:
    made = make_sequence()
    (made.folder / "frames" / "000003.png").unlink()
    with pytest.raises(InputError, match=r"frames/000003\.png is not among the frames"):
        read_sequence(made.folder)


def test_the_shared_sequences_are_found(shared: Path) -> None:
    names = [sequence.name for sequence in read_sequences(shared / "bench" / "sequences")]
    assert len(names) == 16 and names[0] == "easy_00"
    real = {sequence.name for sequence in read_sequences(shared / "data" / "real")}
    assert {"megapose_cube", "visp_dragon", "visp_mbt_cube", "ycbv_scene0000.025_mug"} <= real
