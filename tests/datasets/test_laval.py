"""Laval: OpenGL poses, names with levels, the camera's own keys, and what is missing."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.datasets.laval import (
    from_opengl,
    read_laval,
    split_name,
    to_opengl,
    write_laval_sequence,
)
from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.symmetry import Symmetries
from tests.support.meshes import colored_box
from tests.support.sequence_meshes import AXIS, assert_has_axis


@pytest.fixture
def root(tmp_path: Path, scene: Any, brick: Mesh) -> Path:
    """Three sequences of three frames of one object."""
    for kind in ("occlusion_0", "occlusion_v_30", "stability_near_2"):
        frames = ((scene.image(k), scene.pose(k)) for k in range(3))
        write_laval_sequence(tmp_path, f"dog_{kind}", brick, scene.camera, frames)
    return tmp_path


def test_what_is_written_is_read(root: Path, scene: Any, brick: Mesh) -> None:
    found = read_laval(root)
    assert [one.name for one in found] == [
        "dog_occlusion_0",
        "dog_occlusion_v_30",
        "dog_stability_near_2",
    ]
    assert [one.level for one in found] == ["occlusion_0", "occlusion_30", "stability_near"]
    one = found[1]
    assert (one.object, one.first, one.camera) == ("dog", 0, scene.camera)
    for frame in range(3):
        difference = one.truth[frame].matrix - scene.pose(frame).matrix
        assert difference.abs().max() < 1e-12
    np.testing.assert_array_equal([f.image for f in one.open()], [scene.image(k) for k in range(3)])
    assert not one.symmetric
    assert one.load_mesh().diameter == pytest.approx(brick.diameter, rel=1e-5)
    assert json.loads((one.folder / "meta_data.json").read_text()) == {"metaData": {}}


def test_one_sequence_alone_is_read(root: Path) -> None:
    (one,) = read_laval(root / "dog_occlusion_0")
    assert one.name == "dog_occlusion_0"


def test_poses_are_opengl_and_project_to_the_same_pixel(root: Path, scene: Any) -> None:
    # As the authors project: x fx / −z + cx, and rows from y up.
    matrices = np.load(root / "dog_occlusion_0" / "poses.npy").reshape(-1, 4, 4)
    point = np.array([0.03, -0.01, 0.02, 1.0])
    x, y, z, _ = matrices[1] @ point
    assert z < 0
    camera: Camera = scene.camera
    theirs = [camera.fx * x / -z + camera.cx, camera.cy - camera.fy * y / -z]
    ours = camera.project(scene.pose(1).transform(torch.from_numpy(point[None, :3])))[0]
    np.testing.assert_allclose(theirs, ours, atol=1e-9)


def test_both_shapes_of_poses_mean_the_same(scene: Any) -> None:
    poses = Pose.stack([scene.pose(k) for k in range(4)])
    flat = to_opengl(poses).reshape(-1, 16)
    for values in (flat, flat.reshape(-1, 4, 4)):
        torch.testing.assert_close(from_opengl(values, "here").matrix, poses.matrix)


@pytest.mark.parametrize(
    ("name", "parts"),
    [
        ("cookiejar_occlusion_h_15", ("cookiejar", "occlusion_15")),
        ("wateringcan_occlusion_0", ("wateringcan", "occlusion_0")),
        ("clock_interaction_hard", ("clock", "interaction_hard")),
        ("my_toy_stability_occluded_4", ("my_toy", "stability_occluded")),
    ],
)
def test_names_hold_object_and_level(name: str, parts: tuple[str, str]) -> None:
    assert split_name(name) == parts


def test_a_lens_is_read(root: Path) -> None:
    path = root / "dog_occlusion_0" / "camera.json"
    content = json.loads(path.read_text())
    path.write_text(json.dumps({**content, "distortion": [0.1, -0.2, 0, 0, 0.3]}))
    assert read_laval(root)[0].camera.distortion == (0.1, -0.2, 0, 0, 0.3)
    assert read_laval(root)[1].camera.distortion is None


def test_what_is_wrong_is_said(root: Path, scene: Any, tmp_path_factory: Any) -> None:
    with pytest.raises(InputError, match=r"holds no Laval sequence: looked for .*poses\.npy"):
        read_laval(tmp_path_factory.mktemp("empty"))
    with pytest.raises(InputError, match="is no name of a Laval sequence"):
        split_name("dog")
    opencv = Pose.stack([scene.pose(0)]).matrix.numpy()
    with pytest.raises(InputError, match="these look like OpenCV's"):
        from_opengl(opencv, "here")
    (root / "dog" / "geometry.ply").unlink()
    with pytest.raises(InputError, match=r"mesh is missing; looked for .*dog/geometry\.ply"):
        read_laval(root)
    (root / "dog_occlusion_0" / "camera.json").write_text('{"fx": 1}')
    (root / "dog").rename(root / "geometry")
    (root / "dog_occlusion_0" / "poses.npy").write_bytes(b"text")
    with pytest.raises(InputError, match=r"poses\.npy is not an array"):
        read_laval(root)


def test_a_missing_image_is_a_frame_with_an_error(root: Path) -> None:
    (root / "dog_occlusion_0" / "1.png").unlink()
    frames = list(read_laval(root)[0].open())
    assert [frame.error is None for frame in frames] == [True, False, True]
    (root / "dog_occlusion_0" / "0.png").unlink()
    frames = list(read_laval(root)[0].open())
    assert [frame.error is None for frame in frames] == [False, False, True]
    (root / "dog_occlusion_0" / "2.png").unlink()
    with pytest.raises(InputError, match=r"holds no 0\.png, the first of its 3 frames"):
        read_laval(root)


def test_declared_symmetries_are_kept(tmp_path: Path, scene: Any, brick: Mesh) -> None:
    can = replace(brick, symmetries=Symmetries.from_bop(AXIS))
    frames = ((scene.image(k), scene.pose(k)) for k in range(2))
    write_laval_sequence(tmp_path, "can_occlusion_0", can, scene.camera, frames)
    (found,) = read_laval(tmp_path)
    assert found.symmetric
    assert_has_axis(found.load_mesh())


def test_what_the_format_cannot_hold_is_refused(root: Path, scene: Any, brick: Mesh) -> None:
    def write(name: str, mesh: Mesh = brick, **changes: Any) -> None:
        camera = replace(scene.camera, **changes)
        write_laval_sequence(root, name, mesh, camera, [(scene.image(0), scene.pose(0))])

    fisheye = {"distortion": (0.1, 0, 0, 0), "distortion_model": "fisheye"}
    with pytest.raises(InputError, match=r"holds OpenCV's coefficients, .* of a fisheye lens"):
        write("cat_occlusion_0", **fisheye)
    with pytest.raises(InputError, match="holds no skew, and the camera has one of 2"):
        write("cat_occlusion_0", skew=2)
    assert not list(root.glob("cat*"))
    with pytest.raises(InputError, match=r"geometry\.ply is there and holds another mesh"):
        write("dog_occlusion_h_15", colored_box())
    with pytest.raises(InputError, match=r"geometry\.ply .* a mesh with other symmetries"):
        write("dog_occlusion_h_15", replace(brick, symmetries=Symmetries.from_bop(AXIS)))
    assert len(read_laval(root)) == 3
    lens = (0.1, 0.02, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0)
    write("dog_occlusion_0", distortion=lens)
    assert read_laval(root)[0].camera.distortion == lens
