"""camera.json, pose.json and poses.csv: exact there and back, clear words for bad ones."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from moveit6d.datasets.pose_files import (
    POSE_COLUMNS,
    RESULT_COLUMNS,
    TRACK_COLUMNS,
    PoseRow,
    PoseWriter,
    by_frame,
    read_camera,
    read_poses,
    write_camera,
    write_poses,
)
from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3

CAMERA = {"fx": 600.5, "fy": 601, "cx": 320, "cy": 240.25, "width": 640, "height": 480}


def some_pose(x: float = 0.1) -> Pose:
    return Pose(
        exp_so3(torch.tensor([x, -0.7, 1.3], dtype=torch.float64)),
        torch.tensor([x, -0.02, 0.6], dtype=torch.float64),
    )


def save(path: Path, content: object) -> Path:
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def test_camera_comes_back_exactly(tmp_path: Path) -> None:
    for distortion in (None, (0.1, -0.2, 0.001, 0.0, 0.05)):
        camera = Camera(612.3456789012345, 611.1, 322.0, 239.5, 640, 480, distortion)
        write_camera(tmp_path / "camera.json", camera)
        assert read_camera(tmp_path / "camera.json") == camera


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"fx": None}, "fx missing"),
        ({"fx": "600"}, "fx must be a number"),
        ({"fx": True}, "fx must be a number"),
        ({"fy": -1}, "fx and fy must be positive"),
        ({"cx": float("nan")}, "finite"),
        ({"width": 640.5}, "width must be a whole number"),
        ({"height": 0}, "not an image size"),
        ({"distortion": [0.1, 0.2]}, "4, 5, 8, 12 or 14"),
        ({"distortion": "none"}, "distortion must be a number"),
    ],
)
def test_a_bad_camera_is_named(tmp_path: Path, change: dict[str, object], words: str) -> None:
    path = save(tmp_path / "camera.json", {**CAMERA, **change})
    with pytest.raises(InputError, match=words) as caught:
        read_camera(path)
    assert str(path) in str(caught.value)


def test_a_camera_without_a_key_says_which(tmp_path: Path) -> None:
    path = save(tmp_path / "camera.json", {"fx": 1, "fy": 1, "cx": 0, "width": 4})
    with pytest.raises(InputError, match="cy, height missing"):
        read_camera(path)


@pytest.mark.parametrize("content", ["", "{", "[1, 2]", "\x00\x01"])
def test_what_is_no_json_object_is_refused(tmp_path: Path, content: str) -> None:
    with pytest.raises(InputError, match="JSON"):
        read_camera(save(tmp_path / "camera.json", content))


def test_missing_files_are_named(tmp_path: Path) -> None:
    for read in (read_camera, read_poses):
        with pytest.raises(InputError, match=r"nowhere.* does not exist"):
            read(tmp_path / "nowhere")


def test_pose_comes_back_exactly(tmp_path: Path) -> None:
    some_pose().save(tmp_path / "pose.json")
    back = Pose.load(tmp_path / "pose.json")
    torch.testing.assert_close(back.rotation, some_pose().rotation, rtol=0, atol=1e-15)
    assert torch.equal(back.translation, some_pose().translation)


@pytest.mark.parametrize(
    ("rotation", "translation", "words"),
    [
        ([[1, 0, 0], [0, 1, 0], [0, 0, -1]], [0, 0, 1], "left-handed"),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 0]], [0, 0, 1], "not a rotation"),
        ([[1, 0, 0], [0, 1, 0]], [0, 0, 1], "3×3"),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 1], "3 numbers"),
        ([[1, 0, 0], [0, 1, 0], [0, 0, 1]], [0, 0, float("nan")], "not finite"),
        ("identity", [0, 0, 1], "must be numbers"),
        ([[[1, 0, 0], [0, 1, 0], [0, 0, 1]]], [[0, 0, 1]], "one pose expected"),
    ],
)
def test_a_bad_pose_is_named(
    tmp_path: Path, rotation: object, translation: object, words: str
) -> None:
    path = save(tmp_path / "start.json", {"rotation": rotation, "translation": translation})
    with pytest.raises(InputError, match=words) as caught:
        Pose.load(path)
    assert str(path) in str(caught.value)


def test_poses_come_back_and_holes_stay_holes(tmp_path: Path) -> None:
    path = tmp_path / "new" / "poses.csv"
    rows = [
        PoseRow(0, "a.png", some_pose(), 3, "stop_action", 0.75, 12.5),
        PoseRow(1, "b.png", None, stopped_by="failed"),
        PoseRow(2, 'odd, "name".png', some_pose(0.2), 30, "max_iterations", 0.25, 40.0),
    ]
    write_poses(path, rows)
    lines = path.read_text().splitlines()
    assert lines[0] == (
        "frame,image,r11,r12,r13,r21,r22,r23,r31,r32,r33,tx,ty,tz,"
        "iterations,stopped_by,confidence,probability,milliseconds,state"
    )
    assert lines[2] == "1,b.png,,,,,,,,,,,,,,failed,,,,"
    back = read_poses(path)
    assert [row.image for row in back] == [row.image for row in rows]
    assert back[1].pose is None and back[1].iterations is None and back[1].milliseconds is None
    assert (back[2].iterations, back[2].stopped_by) == (30, "max_iterations")
    assert (back[0].confidence, back[0].milliseconds) == (0.75, 12.5)
    for old, new in zip(rows, back, strict=True):
        if old.pose is not None and new.pose is not None:
            torch.testing.assert_close(new.pose.rotation, old.pose.rotation, rtol=0, atol=1e-9)
            torch.testing.assert_close(
                new.pose.translation, old.pose.translation, rtol=0, atol=1e-9
            )


def test_rows_can_be_read_as_they_are_written(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), PoseWriter(path) as writer:
        assert path.read_text() == "old", "nothing changes before there is a row"
        for number in range(3):
            writer.write(PoseRow(number, pose=some_pose()))
            assert len(read_poses(path)) == number + 1
        raise KeyboardInterrupt
    assert len(read_poses(path)) == 3
    assert list(tmp_path.iterdir()) == [path]


def test_a_table_is_gone_on_with_behind_its_last_whole_row(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    write_poses(path, [PoseRow(number, pose=some_pose()) for number in range(2)])
    with path.open("a") as file:
        file.write("2,cut of")  # as a machine that lost its power may leave it
    with PoseWriter(path, resume=True) as writer:
        writer.write(PoseRow(2, pose=some_pose()))
    assert [row.frame for row in read_poses(path)] == [0, 1, 2]


FULL = """
import resource, sys
from pathlib import Path
from moveit6d.datasets.pose_files import PoseRow, PoseWriter
from moveit6d.errors import InputError
from moveit6d.geometry.pose import Pose
path = Path(sys.argv[1])
resource.setrlimit(resource.RLIMIT_FSIZE, (270, 270))  # a disk with so many bytes left
try:
    with PoseWriter(path) as writer:
        for number in range(9):
            writer.write(PoseRow(number, pose=Pose.identity()))
except InputError as error:
    print(error)
"""


def test_a_full_disk_keeps_the_whole_rows_before(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    done = subprocess.run(
        [sys.executable, "-c", FULL, str(path)], capture_output=True, text=True, check=True
    )
    assert "cannot be written" in done.stdout and "the rows before are kept" in done.stdout
    rows = read_poses(path)
    assert 3 < len(rows) < 9 and path.read_text().endswith("\n")
    assert [row.frame for row in rows] == list(range(len(rows)))


def test_names_that_are_not_utf8_are_written(tmp_path: Path) -> None:
    with PoseWriter(tmp_path / "poses.csv") as writer:
        writer.write(PoseRow(0, image="frame\udce4.png", pose=some_pose()))
    assert read_poses(tmp_path / "poses.csv")[0].image == "frame\\udce4.png"


@pytest.mark.parametrize("place", [0, 3, 99])
def test_columns_that_somebody_added_stay_and_shift_nothing(tmp_path: Path, place: int) -> None:
    path = tmp_path / "poses.csv"
    write_poses(path, [PoseRow(0, pose=some_pose(), state="tracking")])
    lines = [line.split(",") for line in path.read_text().splitlines()]
    for cells, more in zip(lines, ("note", "good"), strict=True):
        cells.insert(place, more)
    path.write_text("".join(",".join(cells) + "\n" for cells in lines))
    with PoseWriter(path, resume=True) as table:
        table.write(PoseRow(1, pose=some_pose(0.2), state="lost"))
    first, second = read_poses(path)
    assert (first.state, second.frame, second.state) == ("tracking", 1, "lost")
    assert second.pose is not None
    assert torch.equal(second.pose.translation, some_pose(0.2).translation)


def test_a_file_without_a_header_is_begun_anew_and_one_with_another_is_refused(
    tmp_path: Path,
) -> None:
    path = tmp_path / "poses.csv"
    for content in ("", "frame,ima"):
        path.write_text(content)
        with PoseWriter(path, resume=True) as table:
            table.write(PoseRow(0, pose=some_pose()))
        assert len(read_poses(path)) == 1
    path.write_text("frame,x\n0,1\n")
    with (
        pytest.raises(InputError, match="its header has no column r11"),
        PoseWriter(path, resume=True),
    ):
        pass
    assert path.read_text() == "frame,x\n0,1\n"


def test_tables_that_call_the_iterations_steps_are_read_and_gone_on_with(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    write_poses(path, [PoseRow(0, pose=some_pose(), iterations=3)])
    path.write_text(path.read_text().replace(",iterations,", ",steps,"))
    with PoseWriter(path, resume=True) as table:
        table.write(PoseRow(1, pose=some_pose(), iterations=2))
    assert [row.iterations for row in read_poses(path)] == [3, 2]
    assert path.read_text().count("steps") == 1


@pytest.mark.parametrize(
    ("column", "value", "words"),
    [
        ("iterations", "nan", "iterations must be a finite number"),
        ("confidence", "inf", "confidence must be a finite number"),
        ("tz", "500", "looks like millimetres"),
        ("frame", "1e300", "frame must be a whole number"),
    ],
)
def test_rows_with_nonsense_are_refused(
    tmp_path: Path, column: str, value: str, words: str
) -> None:
    path = tmp_path / "poses.csv"
    write_poses(path, [PoseRow(0, pose=some_pose(), iterations=3, confidence=0.5)])
    head, row = path.read_text().splitlines()
    cells = row.split(",")
    cells[head.split(",").index(column)] = value
    path.write_text(f"{head}\n{','.join(cells)}\n")
    with pytest.raises(InputError, match=f"line 2.*{words}"):
        read_poses(path)


def test_rows_of_a_mesh_far_from_its_origin_are_read(tmp_path: Path) -> None:
    center = torch.tensor([200.0, 0.0, 0.0], dtype=torch.float64)
    pose = Pose(some_pose().rotation, some_pose().translation - some_pose().rotation @ center)
    write_poses(tmp_path / "poses.csv", [PoseRow(0, pose=pose)])
    (row,) = read_poses(tmp_path / "poses.csv", center=center)
    assert row.pose is not None and float(row.pose.translation.norm()) > 199
    with pytest.raises(InputError, match=r"line 2.*looks like millimetres"):
        read_poses(tmp_path / "poses.csv")


def test_the_middle_of_an_object_is_asked_for_only_where_a_pose_is_far(tmp_path: Path) -> None:
    asked = []

    def center(label: str) -> tuple[float, float, float]:
        asked.append(label)
        return 200.0, 0.0, 0.0

    near, turn = some_pose(), some_pose().rotation
    far = Pose(turn, near.translation - turn @ torch.tensor([200.0, 0, 0], dtype=torch.float64))
    path, columns = tmp_path / "poses.csv", ("frame", "object", *POSE_COLUMNS)
    write_poses(path, [PoseRow(0, pose=near, object="cup")], columns)
    assert read_poses(path, center=center)[0].pose is not None and asked == []
    rows = [
        PoseRow(0, pose=near, object="cup"),
        *(PoseRow(k, pose=far, object="jug") for k in (1, 2)),
    ]
    write_poses(path, rows, columns)
    assert len(read_poses(path, center=center)) == 3 and asked == ["jug"]


def test_an_error_before_the_first_row_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("old")
    with pytest.raises(InputError), PoseWriter(path):
        raise InputError("no such mesh")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_the_objects_of_rows_are_written(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    write_poses(path, [PoseRow(0, object="cup"), PoseRow(0, object="jug")])
    assert [row.object for row in read_poses(path)] == ["cup", "jug"]
    write_poses(path, (PoseRow(k) for k in range(2)))
    assert "object" not in path.read_text() and len(read_poses(path)) == 2


def test_benchmark_columns(tmp_path: Path) -> None:
    path = tmp_path / "easy_00.csv"
    write_poses(path, [PoseRow(4, pose=some_pose(), milliseconds=1.25)], RESULT_COLUMNS)
    head, line = path.read_text().splitlines()
    assert head == "frame,r11,r12,r13,r21,r22,r23,r31,r32,r33,tx,ty,tz,milliseconds"
    assert line.startswith("4,") and line.endswith(",1.2500")


HEAD = "frame,r11,r12,r13,r21,r22,r23,r31,r32,r33,tx,ty,tz"


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no column frame, r11"),
        ("frame,r11\n0,1\n", "no column r12"),
        (f"{HEAD}\n0,1,0,0,0,1,0,0,0,1,0,0\n", "line 2: tz is empty"),
        (f"{HEAD}\n0,1,0,0,0,1,0,0,0,x,0,0,1\n", "line 2: r33 must be a number"),
        (f"{HEAD}\n0.5,1,0,0,0,1,0,0,0,1,0,0,1\n", "line 2: frame must be a whole number"),
        (f"{HEAD}\n0,1,0,0,0,1,0,0,0,-1,0,0,1\n", "line 2: the rotation is left-handed"),
    ],
)
def test_a_bad_poses_file_names_its_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(InputError, match=words):
        read_poses(save(tmp_path / "poses.csv", text))


def test_a_pose_that_is_not_finite_is_no_pose(tmp_path: Path) -> None:
    path = save(tmp_path / "poses.csv", f"{HEAD}\n0,nan,0,0,0,1,0,0,0,1,0,0,1\n")
    assert read_poses(path)[0].pose is None


def test_a_frame_twice_is_refused() -> None:
    with pytest.raises(InputError, match=r"poses\.csv: frame 3 occurs twice"):
        by_frame([PoseRow(3), PoseRow(3)], "poses.csv")


def test_an_older_table_is_gone_on_with_in_its_own_columns(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    older = tuple(column for column in TRACK_COLUMNS if column != "probability")
    row = PoseRow(0, "a.png", some_pose(), 3, "stop_action", 0.9, 5.0, state="tracking")
    write_poses(path, [row], older)
    with PoseWriter(path, resume=True) as table:
        table.write(replace(row, frame=1, probability=0.75))
    lines = path.read_text().splitlines()
    assert [line.count(",") for line in lines] == [len(older) - 1] * 3
    assert [(row.state, row.probability) for row in read_poses(path)] == [("tracking", None)] * 2


def test_the_probability_comes_back_and_the_state_is_the_last_column(tmp_path: Path) -> None:
    row = PoseRow(0, "a.png", some_pose(), confidence=0.9, state="uncertain", probability=0.625)
    write_poses(tmp_path / "poses.csv", [row, PoseRow(1, state="lost")])
    header = (tmp_path / "poses.csv").read_text().splitlines()[0]
    assert header.endswith(",confidence,probability,milliseconds,state")
    found, lost = read_poses(tmp_path / "poses.csv")
    assert (found.confidence, found.probability, lost.probability) == (0.9, 0.625, None)
