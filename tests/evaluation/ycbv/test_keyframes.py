"""YCB-Video's keyframe figures: plain loops on a made excerpt, published ones on the real poses."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from moveit6d.errors import InputError
from moveit6d.evaluation import metrics
from moveit6d.evaluation.metrics import auc
from moveit6d.evaluation.ycbv.keyframes import (
    Keyframes,
    figures,
    keyframe_errors,
    keyframes_table,
    objects_table,
    read_keyframe_poses,
    read_points,
    write_keyframe_poses,
)
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3, random_rotations
from tests.evaluation.metrics.test_auc import by_the_toolbox

ROWS = 60
NAMES = ("002_master_chef_can", "024_bowl", "035_power_drill")


def made() -> tuple[Keyframes, dict[int, torch.Tensor]]:
    """An excerpt of our own: three objects, a method good to some centimetres, a tenth missing."""
    generator = torch.Generator().manual_seed(11)

    def noise(*shape: int) -> torch.Tensor:
        return torch.randn(*shape, dtype=torch.float64, generator=generator)

    objects = torch.arange(ROWS) % 3 + 1
    place = noise(ROWS, 3) * 0.1 + torch.tensor([0.0, 0, 0.9], dtype=torch.float64)
    truth = Pose(random_rotations(ROWS, generator), place)
    size = (torch.arange(ROWS, dtype=torch.float64)[:, None] / ROWS + 0.1) ** 2
    estimate = Pose(
        truth.rotation @ exp_so3(noise(ROWS, 3) * size), place + noise(ROWS, 3) * 0.06 * size
    )
    estimate.rotation[::10], estimate.translation[::10] = math.nan, math.nan
    points = {number: noise(70, 3) * 0.03 for number in (1, 2, 3)}
    return Keyframes(objects, NAMES, truth, {"ours": estimate}), points


def test_areas_agree_with_loops_over_the_rows() -> None:
    keyframes, points = made()
    found = keyframe_errors(keyframes, "ours", points)
    plain: dict[str, list[float]] = {"ADD": [], "ADD-S": []}
    estimate = keyframes.estimates["ours"]
    for k in range(ROWS):
        if k % 10 == 0:
            plain["ADD"].append(math.inf)
            plain["ADD-S"].append(math.inf)
            continue
        x = points[k % 3 + 1].numpy()
        true, mine = (
            x @ pose.rotation[k].numpy().T + pose.translation[k].numpy()
            for pose in (keyframes.truth, estimate)
        )
        plain["ADD"].append(
            float(np.mean([math.dist(a, b) for a, b in zip(true, mine, strict=True)]))
        )
        nearest = np.linalg.norm(true[:, None] - mine[None], axis=-1).min(1)
        plain["ADD-S"].append(float(nearest.mean()))
    mixed = [plain["ADD-S" if k % 3 == 1 else "ADD"][k] for k in range(ROWS)]
    for errors, expected in (
        (found.add, plain["ADD"]),
        (found.add_s, plain["ADD-S"]),
        (found.mixed, mixed),
    ):
        assert errors.tolist() == pytest.approx(expected, abs=1e-9)
        pooled, mean = figures(errors, found.objects, auc.voc_auc)
        assert pooled == pytest.approx(by_the_toolbox(expected, 0.1))
        classes = [by_the_toolbox(expected[first::3], 0.1) for first in range(3)]
        assert mean == pytest.approx(np.mean(classes)) and abs(mean - pooled) > 1e-4


def test_symmetric_objects_are_those_that_are_named() -> None:
    keyframes, points = made()
    literature = keyframe_errors(keyframes, "ours", points)
    assert sorted(set(literature.objects[literature.symmetric].tolist())) == [2]
    other = keyframe_errors(keyframes, "ours", points, symmetric=("035_power_drill",))
    assert sorted(set(other.objects[other.symmetric].tolist())) == [3]
    nobody = keyframe_errors(keyframes, "ours", points, symmetric=())
    torch.testing.assert_close(nobody.mixed, nobody.add)


def test_files_are_read_back(tmp_path: Path) -> None:
    keyframes, points = made()
    write_keyframe_poses(tmp_path / "poses.npz", keyframes)
    back = read_keyframe_poses(tmp_path / "poses.npz", ["ours"])
    assert back.names == NAMES and back.objects.tolist() == keyframes.objects.tolist()
    for mine, theirs in (
        (back.truth, keyframes.truth),
        (back.estimates["ours"], keyframes.estimates["ours"]),
    ):
        torch.testing.assert_close(mine.matrix, theirs.matrix, equal_nan=True)
    np.savez(tmp_path / "points.npz", **{f"{n:02d}": p.numpy() for n, p in points.items()})
    assert {n: p.tolist() for n, p in read_points(tmp_path / "points.npz").items()} == {
        n: p.tolist() for n, p in points.items()
    }


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"obj_id": ["can"]}, "obj_id must be numbers, found an array of str"),
        ({"obj_id": [1.5]}, "obj_id must be .* whole numbers"),
        ({"obj_id": [math.nan]}, "obj_id must be .* whole numbers"),
        ({"obj_id": 1}, r"obj_id must be \(N,\)"),
        (
            {"gt": [["1", "0", "0", "0", "0", "0", "x"]]},
            "gt must be numbers, found an array of str",
        ),
        ({"ours": [[True] * 7]}, "ours must be numbers, found an array of bool"),
    ],
)
def test_text_is_no_pose(tmp_path: Path, change: dict[str, Any], words: str) -> None:
    row = [1.0, 0, 0, 0, 0, 0, 0.9]
    arrays = {"obj_id": [1], "object_names": ["a"], "gt": [row], "ours": [row]}
    np.savez(tmp_path / "p.npz", **arrays | change)
    with pytest.raises(InputError, match=rf"p\.npz: {words}"):
        read_keyframe_poses(tmp_path / "p.npz")


def test_points_are_numbers_of_any_type(tmp_path: Path) -> None:
    np.savez(tmp_path / "p.npz", **{"01": [["x", "y", "z"]]})
    with pytest.raises(InputError, match=r"p\.npz: points of object 1 must be numbers"):
        read_points(tmp_path / "p.npz")
    np.savez(tmp_path / "p.npz", **{"01": np.ones((4, 3), ">f4"), "02": np.ones((4, 3), "u2")})
    assert all(points.dtype == torch.float64 for points in read_points(tmp_path / "p.npz").values())


def test_quaternions_need_not_be_unit_ones(tmp_path: Path) -> None:
    turn = Rotation.from_rotvec([0.3, -0.2, 0.5])
    row = [*(0.4 * turn.as_quat(scalar_first=True)), 0.1, 0.2, 0.9]
    np.savez(tmp_path / "p.npz", obj_id=[1], object_names=["a"], gt=[row], ours=[[0] * 7])
    read = read_keyframe_poses(tmp_path / "p.npz")
    assert read.truth.rotation[0].numpy() == pytest.approx(turn.as_matrix())
    assert read.truth.translation[0].tolist() == [0.1, 0.2, 0.9]
    assert torch.isnan(read.estimates["ours"].rotation).all()


ROW = [[1.0, 0, 0, 0, 0, 0, 1]]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        ({"gt": ROW}, "holds no obj_id, object_names"),
        ({"obj_id": [1], "object_names": ["a"], "gt": ROW}, "there are none"),
        ({"obj_id": [2], "object_names": ["a"], "gt": ROW, "m": ROW}, "obj_id must be 1 … 1"),
        ({"obj_id": [1], "object_names": ["a"], "gt": [[0] * 7], "m": ROW}, "without a pose"),
        ({"obj_id": [1], "object_names": ["a"], "gt": ROW, "m": [[1.0]]}, r"must be \(1, 7\)"),
    ],
)
def test_what_is_wrong_with_poses_is_said(tmp_path: Path, content: dict, words: str) -> None:
    np.savez(tmp_path / "poses.npz", **content)
    with pytest.raises(InputError, match=words):
        read_keyframe_poses(tmp_path / "poses.npz")


def test_what_is_wrong_with_files_is_said(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="does not exist"):
        read_points(tmp_path / "none.npz")
    (tmp_path / "text.npz").write_text("hello")
    with pytest.raises(InputError, match=r"not an \.npz file"):
        read_points(tmp_path / "text.npz")
    for values, words in (
        ({"a": [[0, 0, 0]]}, "numbers of objects"),
        ({"01": [0, 0, 0]}, r"must be \(M, 3\)"),
        ({"01": [[0, 0, 80.0]]}, "looks like millimetres"),
    ):
        np.savez(tmp_path / "points.npz", **values)
        with pytest.raises(InputError, match=words):
            read_points(tmp_path / "points.npz")
    keyframes, points = made()
    del points[2]
    with pytest.raises(InputError, match=r"points of object 2 \(024_bowl\)"):
        keyframe_errors(keyframes, "ours", points)


def test_tables_name_what_is_missing_and_what_is_symmetric() -> None:
    keyframes, points = made()
    found = {"ours": keyframe_errors(keyframes, "ours", points)}
    rows = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in keyframes_table(found, auc.exact_auc).splitlines()
    ]
    pooled, mean = figures(found["ours"].add, keyframes.objects, auc.exact_auc)
    assert rows[2][:4] == ["ours", "60", "6", f"{100 * pooled:.2f}"]
    assert rows[2][6] == f"{100 * mean:.2f}"
    assert rows[2][9] == f"{100 * metrics.accuracy(found['ours'].add_s, 0.02):.2f}"
    lines = objects_table(found, NAMES).splitlines()
    assert len(lines) == 5 and lines[3].startswith("| 024_bowl *") and "*" not in lines[2]


def test_published_add_of_posecnn(shared: Path) -> None:
    """data/real/README.md; ADD-S and others take minutes: see docs/reference/metrics.md."""
    folder = shared / "data" / "real" / "ycbv_keyframe_poses"
    keyframes = read_keyframe_poses(folder / "poses.npz", ["posecnn"])
    points = read_points(folder / "points.npz")
    add = torch.full((len(keyframes.objects),), math.inf, dtype=torch.float64)
    for number, x in points.items():
        rows = keyframes.objects == number
        pair = keyframes.estimates["posecnn"][rows], keyframes.truth[rows]
        add[rows] = metrics.errors_of(metrics.add, *pair, x)
    pooled, mean = figures(add, keyframes.objects, auc.voc_auc)
    assert round(100 * pooled, 2) == 53.71 and round(100 * mean, 2) == 51.50
    assert int(torch.isinf(add).sum()) == 163
