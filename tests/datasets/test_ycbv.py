"""YCB-Video as published: MAT files with their quirks, keyframes, cameras, several objects."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.io import savemat

from moveit6d.datasets import ycbv
from moveit6d.datasets.catalog import open_dataset
from moveit6d.datasets.ycbv import read_keyframes, read_meta, read_ycbv, write_ycbv_scene
from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.symmetry import Symmetries
from tests.support.meshes import colored_box
from tests.support.sequence_meshes import AXIS, assert_has_axis

DRILL, BOWL = 15, 13  # classes, from 1


@pytest.fixture
def root(tmp_path: Path, scene: Any, brick: Mesh) -> Path:
    """Scene 48 with two objects, one of which comes late, and scene 2, which has no keyframe."""

    def frames() -> Any:
        for k in range(5):
            poses = {DRILL: scene.pose(k), BOWL: scene.pose(k + 9)} if k else {DRILL: scene.pose(0)}
            yield scene.image(k), poses

    for number in (2, 48):
        objects = {DRILL: brick, BOWL: brick}
        write_ycbv_scene(tmp_path, number, objects, scene.camera, frames(), every=2)
    (tmp_path / "keyframe.txt").write_text("0048/000001\n0048/000003\n0048/000005\n")
    return tmp_path


def test_what_is_written_is_read(root: Path, scene: Any, brick: Mesh) -> None:
    bowl, drill = read_ycbv(root)
    assert (bowl.name, drill.name) == ("0048.024_bowl", "0048.035_power_drill")
    assert (drill.level, drill.object) == ("035_power_drill", "035_power_drill")
    assert bowl.symmetric and not drill.symmetric
    assert drill.camera == scene.camera
    assert (drill.first, bowl.first) == (0, 1) and list(bowl.truth) == [1, 2, 3, 4]
    assert drill.keyframes == {0, 2, 4} and bowl.keyframes == {2, 4}
    for frame, pose in bowl.truth.items():
        assert (pose.matrix - scene.pose(frame + 9).matrix).abs().max() < 1e-12
    np.testing.assert_array_equal([f.image for f in drill.open()][4], scene.image(4))
    assert drill.load_mesh().diameter == pytest.approx(brick.diameter, rel=1e-5)
    assert drill.points is not None
    points = np.loadtxt(drill.points)
    low, high = points.min(0), points.max(0)
    assert len(points) == 2620
    np.testing.assert_allclose((low + high) / 2, [0.03, -0.01, 0.02], atol=1e-3)


def test_scenes_can_be_named(root: Path) -> None:
    assert [one.name[:4] for one in read_ycbv(root, [2])] == ["0002", "0002"]
    assert read_ycbv(root, [2])[0].keyframes is None
    with pytest.raises(InputError, match="none of the scenes 7; scenes there: 2, 48"):
        read_ycbv(root, [7])


def test_what_is_not_there_is_counted(root: Path, caplog: pytest.LogCaptureFixture) -> None:
    open_dataset(root)
    assert not caplog.messages
    keyframes = ["0048/000001", "0048/000003", "0048/000009", "0050/000001", "0051/000002"]
    (root / "keyframe.txt").write_text("\n".join(keyframes))
    assert [one.keyframes for one in open_dataset(root)] == [{2}, {0, 2}]
    said = "not complete: 2 of 3 scenes and 3 of 5 keyframes are not there, and left out of figures"
    assert caplog.messages == [f"{root} is {said}"]
    caplog.clear()
    (root / "data" / "0048" / "000003-meta.mat").unlink()  # the image alone has no true pose
    assert [one.keyframes for one in read_ycbv(root, [48])] == [set(), {0}]
    assert caplog.messages == [
        f"{root} is not complete: 2 of 3 keyframes are not there, and left out of figures"
    ]


def test_official_quirks_of_meta_files(tmp_path: Path) -> None:
    pose = np.arange(12.0).reshape(3, 4)
    # One object: MATLAB drops the last axis of the poses; classes may be flat, of uint8.
    savemat(tmp_path / "one.mat", {"cls_indexes": np.array([21], np.uint8), "poses": pose})
    assert list(read_meta(tmp_path / "one.mat")) == [21]
    np.testing.assert_array_equal(read_meta(tmp_path / "one.mat")[21], pose)
    two = {"cls_indexes": np.array([[3], [5]], np.uint8), "poses": np.stack([pose, pose + 1], -1)}
    savemat(tmp_path / "two.mat", two)
    np.testing.assert_array_equal(read_meta(tmp_path / "two.mat")[5], pose + 1)
    savemat(tmp_path / "bad.mat", {**two, "cls_indexes": np.array([[3]])})
    with pytest.raises(InputError, match="poses must be 3 × 4 × 1"):
        read_meta(tmp_path / "bad.mat")
    savemat(tmp_path / "less.mat", {"poses": pose})
    with pytest.raises(InputError, match="has no variable cls_indexes"):
        read_meta(tmp_path / "less.mat")
    (tmp_path / "no.mat").write_bytes(b"nothing")
    with pytest.raises(InputError, match="is not a readable MAT file"):
        read_meta(tmp_path / "no.mat")


def test_vertmap_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def watch(path: Path, names: Any) -> dict[str, Any]:
        asked.append(names)
        return {"cls_indexes": np.array([1]), "poses": np.zeros((3, 4))}

    monkeypatch.setattr(ycbv, "read_mat", watch)
    read_meta(tmp_path / "any.mat")
    assert asked == [("cls_indexes", "poses")]


@pytest.mark.parametrize(("scene_number", "fx"), [(59, 1066.778), (60, 1077.836)])
def test_without_a_matrix_the_scene_tells_the_camera(
    tmp_path: Path, scene: Any, brick: Mesh, scene_number: int, fx: float
) -> None:
    frames = [(np.zeros((480, 640, 3), np.uint8), {DRILL: scene.pose(0)})]
    place = write_ycbv_scene(tmp_path, scene_number, {DRILL: brick}, scene.camera, frames)
    content = {"cls_indexes": np.array([DRILL]), "poses": scene.pose(0).matrix[:3].numpy()}
    savemat(place / "000001-meta.mat", content)
    (one,) = read_ycbv(tmp_path)
    assert one.camera.fx == fx and one.camera.width == 640


def test_own_names_are_read(tmp_path: Path, scene: Any, brick: Mesh) -> None:
    frames = [(scene.image(0), {2: scene.pose(0)})]
    write_ycbv_scene(tmp_path, 0, {2: brick}, scene.camera, frames, names=("boot", "mug"))
    (one,) = read_ycbv(tmp_path)
    assert one.object == "mug" and one.mesh == tmp_path / "models/mug/textured_simple.obj"


def test_the_other_layout_is_named(tmp_path: Path) -> None:
    (tmp_path / "test" / "000048").mkdir(parents=True)
    (tmp_path / "test" / "000048" / "scene_gt.json").write_text("{}")
    with pytest.raises(InputError, match=r"This is BOP's YCB-V, .* --format bop"):
        read_ycbv(tmp_path)
    with pytest.raises(InputError, match=r"looked for data/0048/000001-meta\.mat\.$"):
        read_ycbv(tmp_path / "test")


def test_a_bad_keyframe_line_is_said(tmp_path: Path) -> None:
    (tmp_path / "keyframe.txt").write_text("0048-000001\n")
    with pytest.raises(InputError, match=r"keyframe\.txt: '0048-000001' is no line"):
        read_keyframes(tmp_path)


def test_the_published_list_of_objects() -> None:
    assert len(ycbv.OBJECTS) == 21 and set(ycbv.SYMMETRIC) < set(ycbv.OBJECTS)
    # DenseFusion's symmetry_obj_idx, counted from 0.
    assert [ycbv.OBJECTS.index(name) for name in ycbv.SYMMETRIC] == [12, 15, 18, 19, 20]


def test_a_pose_that_is_none_is_refused(root: Path) -> None:
    path = root / "data" / "0048" / "000002-meta.mat"
    savemat(path, {"cls_indexes": np.array([DRILL]), "poses": np.ones((3, 4))})
    with pytest.raises(InputError, match="0048, 035_power_drill: the 3×3 matrix is not a rotation"):
        read_ycbv(root)


def test_declared_symmetries_are_kept(tmp_path: Path, scene: Any, brick: Mesh) -> None:
    can = replace(brick, symmetries=Symmetries.from_bop(AXIS))
    frames = ((scene.image(k), {1: scene.pose(k)}) for k in range(2))
    write_ycbv_scene(tmp_path, 48, {1: can}, scene.camera, frames, ["can"])
    (found,) = read_ycbv(tmp_path)
    assert found.symmetric
    assert_has_axis(found.load_mesh())


def test_what_the_format_cannot_hold_is_refused(root: Path, scene: Any, brick: Mesh) -> None:
    def write(mesh: Mesh = brick, names: Any = ycbv.OBJECTS, **changes: Any) -> None:
        frames = [(scene.image(0), {DRILL: scene.pose(0)})]
        camera = replace(scene.camera, **changes)
        write_ycbv_scene(root, 50, {DRILL: mesh}, camera, frames, names)

    with pytest.raises(InputError, match="0050: YCB-Video's format holds no lens distortion"):
        write(distortion=(0.1, 0, 0, 0))
    with pytest.raises(InputError, match=r"textured_simple\.obj is there and holds another mesh"):
        write(colored_box())
    with pytest.raises(InputError, match=r"classes\.txt: class 1 is 002_master_chef_can .* mug"):
        write(names=("mug",) * DRILL)
    assert not (root / "data" / "0050").exists()
    write(names=ycbv.OBJECTS[:DRILL], skew=2)
    assert ycbv.object_names(root) == ycbv.OBJECTS
    assert read_ycbv(root, [50])[0].camera.skew == 2


def test_a_published_mesh_is_not_put_aside(root: Path, scene: Any, brick: Mesh) -> None:
    folder = root / "models" / ycbv.OBJECTS[DRILL - 1]
    (folder / "textured_simple.obj").rename(folder / "textured.obj")
    write_ycbv_scene(root, 50, {DRILL: brick}, scene.camera, [(scene.image(0), {})])
    assert not (folder / "textured_simple.obj").exists()


@pytest.mark.parametrize("number", [1, 3, 5])
def test_a_missing_image_is_a_frame_with_an_error(root: Path, scene: Any, number: int) -> None:
    image = root / "data" / "0048" / f"{number:06d}-color.png"
    image.unlink()
    bowl, _ = read_ycbv(root)
    frames = list(bowl.open())
    assert [frame.index for frame in frames if frame.image is None] == [number - 1]
    assert frames[number - 1].error == f"{image} does not exist."
    assert list(bowl.truth) == [1, 2, 3, 4] and bowl.keyframes == {2, 4}
    for frame, pose in bowl.truth.items():
        assert (pose.matrix - scene.pose(frame + 9).matrix).abs().max() < 1e-12
    image.with_name(f"{number:06d}-meta.mat").unlink()  # a part of the data set: no such frame
    assert len(list(read_ycbv(root)[0].open())) == 4


def test_a_damaged_first_image_is_a_frame_with_an_error(root: Path) -> None:
    (root / "data" / "0048" / "000001-color.png").write_bytes(b"nothing")
    frames = list(read_ycbv(root)[1].open())
    assert [frame.error is None for frame in frames] == [False, True, True, True, True]
