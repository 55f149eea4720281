"""BOP result files: order and units, and bad rows named."""

from __future__ import annotations

from pathlib import Path

import pytest
import torch

from moveit6d.datasets.bop import (
    Estimate,
    by_image,
    read_results,
    write_results,
)
from moveit6d.errors import InputError
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3

HEAD = "scene_id,im_id,obj_id,score,R,t,time\n"


EYE = "1 0 0 0 1 0 0 0 1"


def test_results_come_back_in_order_and_in_metres(tmp_path: Path) -> None:
    pose = Pose(
        exp_so3(torch.tensor([0.3, -2.0, 0.4], dtype=torch.float64)),
        torch.tensor([0.0123456789, -0.2, 1.5], dtype=torch.float64),
    )
    rows = [
        Estimate(2, 17, 5, 0.25, pose),
        Estimate(2, 3, 6, 0.75, pose, 0.5),
        Estimate(2, 17, 1, 1.0, pose, 0.125),
    ]
    path = tmp_path / "out" / "refined.csv"
    write_results(path, rows)
    text = path.read_text().splitlines()
    assert text[0] + "\n" == HEAD and text[1].endswith("12.3456789 -200 1500,-1")
    back = read_results(path)
    for old, new in zip(rows, back, strict=True):
        assert (old.scene, old.image, old.object) == (new.scene, new.image, new.object)
        assert (old.score, old.seconds) == (new.score, new.seconds)
        torch.testing.assert_close(new.pose.matrix, pose.matrix, rtol=0, atol=1e-9)
    assert list(by_image(back)) == [((2, 17), [0, 2]), ((2, 3), [1])]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "its first line must be scene_id"),
        (HEAD, "holds no estimate"),
        (HEAD + f"2,3,5,1,{EYE},0 0 900\n", "row 1: 7 fields expected, found 6"),
        (HEAD + f"2,3,5,1,{EYE},0 0 900,-1\n2,3,5,1,1 0 0,0 0 900,-1\n", "row 2: R must have 9"),
        (HEAD + f"2,x,5,1,{EYE},0 0 900,-1\n", "row 1: could not convert"),
        (HEAD + f"2,3,5,nan,{EYE},0 0 900,-1\n", "row 1: the score must be a finite number"),
        (HEAD + f"2,3,5,1,{EYE},0 0 nan,-1\n", "row 1: t must be a finite number"),
        (HEAD + "2,3,5,1,1 0 0 0 1 0 0 0 -1,0 0 900,-1\n", "row 1: the rotation is left-handed"),
    ],
)
def test_a_bad_result_file_names_its_row(tmp_path: Path, text: str, words: str) -> None:
    (tmp_path / "poses.csv").write_text(text)
    with pytest.raises(InputError, match=words):
        read_results(tmp_path / "poses.csv")


@pytest.mark.parametrize("head", ["", "scene_id,im_id,obj_id,score,R,t,time\n", "\ufeff"])
@pytest.mark.parametrize("numbers", ["1,0,2", "1.0,0.0,2.0", "000001,000000,000002"])
def test_results_with_and_without_header(tmp_path: Path, head: str, numbers: str) -> None:
    (tmp_path / "r.csv").write_text(f"{head}{numbers},0.5,1 0 0 0 1 0 0 0 1,0 0 400,-1\n")
    (row,) = read_results(tmp_path / "r.csv")
    assert (row.scene, row.image, row.object, row.score) == (1, 0, 2, 0.5)
    assert row.pose.translation.tolist() == [0, 0, 0.4]


@pytest.mark.parametrize("head", ["", HEAD])
def test_translations_in_metres_are_refused(tmp_path: Path, head: str) -> None:
    path, rows = tmp_path / "r.csv", [f"1,{k},2,0.5,{EYE},0.1 0 0.{4 + k},-1" for k in range(3)]
    path.write_text(head + "\n".join(rows))
    with pytest.raises(InputError, match=r"r\.csv: .* 0\.51 mm long, which looks like metres"):
        read_results(path)
    nothing = [f"1,{k},2,0,{EYE},0 0 0,-1" for k in range(3, 9)]  # written for nothing found
    path.write_text(head + "\n".join([*nothing, f"1,0,2,0.5,{EYE},0 0 400,-1"]))
    assert len(read_results(path)) == 7
    path.write_text(head + "\n".join(nothing))
    assert len(read_results(path)) == 6
