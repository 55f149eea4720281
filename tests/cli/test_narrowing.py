"""What is known of where an object is in a video's first frame."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from moveit6d import Camera, InputError
from moveit6d.cli.common import Setting
from moveit6d.cli.main import main
from moveit6d.cli.narrowing import (
    advice,
    check_first,
    is_narrowed,
    known_of,
    read_mask,
    searching_within,
)
from moveit6d.config import RegionConfig
from moveit6d.datasets.pose_files import read_poses
from moveit6d.estimation.detection import SearchRegion
from moveit6d.geometry.pose import Pose

Make = Callable[..., Any]
NOTHING: dict[str, Any] = dict.fromkeys(("box", "mask", "points", "distance", "start"))


@pytest.fixture
def made(make_sequence: Make, scene: Any) -> Any:
    """A clip of the brick, and a file of the pixels of its corners in the first frame."""
    made = make_sequence("clip", frames=3)
    corners = torch.from_numpy(scene.mesh.vertices[::9].astype(float) + scene.mesh.center)
    pixels = scene.camera.project(made.poses[0].transform(corners))
    rows = torch.cat([pixels, corners], 1).numpy()
    np.savetxt(made.folder / "points.csv", rows, delimiter=",")
    return made


def track(made: Any, *more: str) -> int:
    words = {
        "--mesh": "mesh.ply", "--video": "frames", "--camera": "camera.json", "--output": "out",
    }  # fmt: skip
    files = [word for name, file in words.items() for word in (name, str(made.folder / file))]
    return main(["track", *files, "--mesh_unit", "m", "--no_overlay", *more])


def first(made: Any) -> Pose:
    pose = read_poses(made.folder / "out" / "poses.csv")[0].pose
    assert pose is not None
    return pose


def off(pose: Pose, true: Pose) -> float:
    return float((pose.translation - true.translation).norm())


def test_a_track_begins_at_clicked_points(made: Any) -> None:
    assert track(made, "--points", str(made.folder / "points.csv")) == 0
    assert off(first(made), made.poses[0]) < 0.01


def test_a_track_begins_in_a_box(made: Any, scene: Any, capsys: Any) -> None:
    u, v = scene.camera.project(scene.mesh.inner(made.poses[0]).translation).tolist()
    box = [str(round(value)) for value in (u - 22, v - 18, 44, 36)]
    assert track(made, "--box", *box, "--distance", "0.3", "0.8") == 0
    assert off(first(made), made.poses[0]) < 0.01
    # Where it is not, the whole image follows.
    assert track(made, "--box", "125", "5", "30", "30", "--distance", "0.5", "0.9") == 0
    assert "is not found in the first frame where it should be" in capsys.readouterr().err
    assert off(first(made), made.poses[0]) < 0.01


def test_points_do_for_a_mesh_without_colours(made: Any, scene: Any, capsys: Any) -> None:
    rows = [f"v {x} {y} {z}" for x, y, z in scene.mesh.vertices + scene.mesh.center]
    rows += [f"f {a} {b} {c}" for a, b, c in scene.mesh.faces + 1]
    plain: Path = made.folder / "plain.obj"
    plain.write_text("\n".join(rows))
    points = str(made.folder / "points.csv")
    assert main([
        "track", "--mesh", str(plain), "--mesh_unit", "m", "--video", str(made.folder / "frames"),
        "--camera", str(made.folder / "camera.json"), "--output", str(made.folder / "out"),
        "--no_overlay", "--points", points, "--texture_from_start",
    ]) == 0  # fmt: skip
    assert off(first(made), made.poses[0]) < 0.01


def test_what_does_not_go_together_is_refused(made: Any, capsys: Any) -> None:
    assert not is_narrowed(Namespace(**NOTHING))
    check_first(Namespace(**NOTHING, mesh=["a", "b"]))
    with pytest.raises(InputError, match="are for one object"):
        check_first(Namespace(**{**NOTHING, "box": [1, 2, 3, 4]}, mesh=["a", "b"]))
    check_first(Namespace(**{**NOTHING, "distance": [0.1, 2]}, mesh=["a", "b"]))
    points, start = str(made.folder / "points.csv"), str(made.folder / "start.json")
    assert track(made, "--points", points, "--start", start) == 2
    assert "--start says the pose" in capsys.readouterr().err
    assert track(made, "--points", points, "--exact_start") == 2
    assert "--exact_start needs the pose" in capsys.readouterr().err


def test_a_box_and_a_mask_of_two_places_are_refused(made: Any, capsys: Any) -> None:
    mask = np.zeros((120, 160), np.uint8)
    mask[40:70, 50:90] = 255
    Image.fromarray(mask).save(made.folder / "mask.png")
    both = ["--mask", str(made.folder / "mask.png"), "--box"]
    assert track(made, *both, "100", "80", "40", "30") == 2
    said = capsys.readouterr().err
    assert "box and mask contradict each other: 0 % of the mask is inside of the box" in said
    assert "the mask reaches from 50 40 to 89 69. Leave one of them out." in said
    args = Namespace(**{**NOTHING, "mask": made.folder / "mask.png", "box": [30, 30, 40, 40]})
    known = known_of(args, "m")
    assert known["mask"].any(), "drawn roughly"
    camera = Camera(180.0, 182.0, 78.0, 61.0, 160, 120)
    SearchRegion.checked(camera, known["box"], known["mask"]).check_common(RegionConfig())


@pytest.mark.parametrize(
    ("meshes", "given", "expected"),
    [
        (1, [], "; narrow the search by --box or --mask or --points or --distance or --start"),
        (1, ["distance"], "; check --distance, or narrow the search by --box or --mask or --points "
         "or --start"),
        (2, [], "; narrow the search by --distance or --start"),
        (2, ["distance"], "; check --distance, or narrow the search by --start"),
        (2, ["distance", "start"], "; check --distance and --start"),
    ],
)  # fmt: skip
def test_what_is_advised_where_nothing_was_found(
    meshes: int, given: list[str], expected: str
) -> None:
    known = {**NOTHING, **{name: [0.1, 2] for name in given}}
    assert advice(Namespace(**known, mesh=["a.ply"] * meshes)) == expected


def test_points_in_another_unit_are_refused(made: Any, capsys: Any) -> None:
    rows = np.loadtxt(made.folder / "points.csv", delimiter=",")
    np.savetxt(made.folder / "mm.csv", rows * [1, 1, 1000, 1000, 1000], delimiter=",")
    assert track(made, "--points", str(made.folder / "mm.csv")) == 2
    assert "x, y, z must be in the mesh file's unit and frame" in capsys.readouterr().err


DISC, INNER = (np.hypot(*np.mgrid[-60:60, -80:80]) < radius for radius in (40, 37))


def photo() -> np.ndarray:
    """Colours from nearly black to nearly white."""
    return np.random.default_rng(0).integers(1, 250, (*DISC.shape, 3), np.uint8)


def cut_out() -> Image.Image:
    return Image.fromarray(np.dstack([photo(), np.where(DISC, 255, 0).astype(np.uint8)]))


def labels(*values: int) -> Image.Image:
    """An image of labels: the disc's two halves, and nothing around it."""
    rows = np.arange(DISC.shape[0])[:, None] < 60
    return Image.fromarray((DISC * np.where(rows, values[0], values[-1])).astype(np.uint8))


@pytest.mark.parametrize(
    ("picture", "name"),
    [
        (Image.fromarray(DISC), "bits.png"),
        (labels(1), "ones.png"),
        (labels(255), "white.png"),
        (labels(255), "white.jpg"),
        (labels(3, 7), "labels.png"),
        (Image.fromarray(np.where(INNER, 3, labels(255)).astype(np.uint8)), "void.png"),
        (Image.fromarray(DISC.astype(np.uint16) * 65535), "deep.png"),
        (Image.fromarray(np.dstack([labels(255)] * 3 + [np.full(DISC.shape, 255, np.uint8)])),
         "opaque.png"),
        (cut_out(), "cut_out.png"),
        (Image.fromarray(photo() * DISC[..., None]), "on_black.png"),
    ],
)  # fmt: skip
def test_masks_of_many_kinds(tmp_path: Path, picture: Any, name: str, capsys: Any) -> None:
    picture.save(tmp_path / name)
    np.testing.assert_array_equal(read_mask(tmp_path / name), DISC)
    assert not capsys.readouterr().err


def test_a_mask_of_nearly_everything_is_said(tmp_path: Path, capsys: Any) -> None:
    Image.fromarray(photo()).save(tmp_path / "photo.png")
    assert read_mask(tmp_path / "photo.png").all()
    assert "photo.png: the mask is 100 % of the image" in capsys.readouterr().err


def test_a_distance_holds_for_the_whole_video() -> None:
    setting = Setting(None, "embree", 1)
    assert searching_within(setting, None) is setting
    within = searching_within(setting, [0.3, 0.8])
    assert within.config.recovery.distance == (0.3, 0.8)
    with pytest.raises(InputError, match=r"--distance and the setting recovery\.distance"):
        searching_within(within, [0.4, 0.8])
