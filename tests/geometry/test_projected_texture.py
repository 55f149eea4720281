"""Painting a mesh from a picture: the picture comes back, the hidden sides are plain."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from moveit6d import Camera, InputError, Mesh, Pose
from moveit6d.geometry.rotation import exp_so3
from moveit6d.rendering import make_renderer
from moveit6d.rendering.shading import shade_plain
from tests.support import meshes

CAMERA = Camera(600.0, 600.0, 127.5, 127.5, 256, 256)
TURN = exp_so3(torch.tensor([0.4, 0.7, 0.1], dtype=torch.float64))


def rendered(mesh: Mesh, pose: Pose) -> tuple[np.ndarray, np.ndarray]:
    """Image (256, 256, 3) uint8 on green, and mask."""
    centred = mesh.inner(pose)
    batch = Pose(centred.rotation[None], centred.translation[None])
    seen = make_renderer().render([mesh], batch, CAMERA.matrix[None], 256)
    green = torch.tensor([0.1, 0.6, 0.2])[:, None, None]
    image = shade_plain(seen)[0] * seen.mask[0] + green * (1 - seen.mask[0])
    return (255 * image).round().byte().permute(1, 2, 0).numpy(), seen.mask[0, 0].numpy() > 0


@pytest.fixture
def painted() -> tuple[Mesh, Mesh, Pose]:
    """A box with a noisy texture, its plain twin painted from a picture, and the pose."""
    noise = np.random.default_rng(1).integers(60, 200, (16, 16, 3), np.uint8)
    true = meshes.textured_box(noise.repeat(8, 0).repeat(8, 1), (0.1, 0.08, 0.06))
    vertices, faces, *_ = meshes.box_arrays((0.1, 0.08, 0.06))
    plain = Mesh.from_arrays("box", vertices, faces)
    pose = Pose(TURN, torch.tensor([0.01, 0.0, 0.45], dtype=torch.float64))
    assert true.has_colours and not plain.has_colours
    return true, plain.textured_from(rendered(true, pose)[0], pose, CAMERA), pose


def test_the_picture_comes_back(painted: tuple[Mesh, Mesh, Pose]) -> None:
    true, mesh, pose = painted
    (expected, mask), (found, again) = rendered(true, pose), rendered(mesh, pose)
    assert mesh.has_colours and (mask == again).mean() > 0.999
    difference = np.abs(expected.astype(int) - found)[mask].mean(1)
    assert np.median(difference) < 8 and (difference < 25).mean() > 0.9
    assert mesh.diameter == pytest.approx(true.diameter)


def test_a_little_turn_still_looks_right(painted: tuple[Mesh, Mesh, Pose]) -> None:
    true, mesh, pose = painted
    about = exp_so3(torch.tensor([0.0, 0.12, 0.05], dtype=torch.float64))
    turned = Pose(about @ pose.rotation, pose.translation)
    (expected, mask), (found, _) = rendered(true, turned), rendered(mesh, turned)
    assert np.median(np.abs(expected.astype(int) - found)[mask]) < 15


def test_what_is_hidden_is_plain(painted: tuple[Mesh, Mesh, Pose]) -> None:
    _, mesh, pose = painted
    behind = exp_so3(torch.tensor([0.0, torch.pi, 0.0], dtype=torch.float64))
    found, mask = rendered(mesh, Pose(behind @ pose.rotation, pose.translation))
    inner = found[mask].astype(int)
    # No green of the background, and hardly any print.
    assert (inner[:, 1] - inner[:, 0] < 60).mean() > 0.98 and inner.std(0).max() < 45


def test_every_kind_of_image_and_pose_paints_the_same(painted: tuple[Mesh, Mesh, Pose]) -> None:
    true, mesh, pose = painted
    image = rendered(true, pose)[0]
    vertices, faces, *_ = meshes.box_arrays((0.1, 0.08, 0.06))
    plain = Mesh.from_arrays("box", vertices, faces)
    kinds: list[tuple[Any, Any]] = [
        (image / 255, pose),
        ((image / 255).astype(np.float32), pose),
        (Image.fromarray(image), pose),
        (torch.from_numpy(image).permute(2, 0, 1), pose),
        (image, pose.matrix.numpy()),
        (image, pose.matrix.tolist()),
    ]
    assert mesh.texture is not None
    for picture, place in kinds:
        again = plain.textured_from(picture, place, CAMERA).texture
        assert again is not None and np.array_equal(again, mesh.texture)
    grey = plain.textured_from(image[..., 0], pose, CAMERA).texture
    assert grey is not None and np.array_equal(grey[..., 0], grey[..., 2]) and grey.std() > 5


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"image": np.zeros((128, 128, 3), np.uint8)}, "is 128×128 but the camera is 256×256"),
        ({"image": np.full((256, 256, 3), 200.0)}, r"must lie in \[0, 1\]"),
        ({"image": "frame.png"}, "expected an array"),
        ({"pose": np.eye(3)}, "pose must be a Pose or a 4×4 matrix"),
        ({"pose": None}, "pose must be a Pose or a 4×4 matrix, found NoneType"),
        ({"camera": CAMERA.matrix.numpy()}, "camera must be a Camera"),
    ],
)
def test_what_is_no_image_pose_or_camera_is_one_sentence(
    change: dict[str, Any], words: str
) -> None:
    vertices, faces, *_ = meshes.box_arrays()
    plain = Mesh.from_arrays("box", vertices, faces)
    pose = Pose(TURN, torch.tensor([0.0, 0.0, 0.4], dtype=torch.float64))
    given = {"image": np.zeros((256, 256, 3), np.uint8), "pose": pose, "camera": CAMERA, **change}
    with pytest.raises(InputError, match=words):
        plain.textured_from(**given)


def test_from_behind_the_camera_there_is_nothing_to_take() -> None:
    vertices, faces, *_ = meshes.box_arrays()
    plain = Mesh.from_arrays("box", vertices, faces)
    pose = Pose(TURN, torch.tensor([0.0, 0.0, -0.6], dtype=torch.float64))
    with pytest.raises(InputError, match="box: the camera sees too little"):
        plain.textured_from(np.zeros((256, 256, 3), np.uint8), pose, CAMERA)


def test_out_of_the_picture_there_is_nothing_to_take() -> None:
    vertices, faces, *_ = meshes.box_arrays()
    plain = Mesh.from_arrays("box", vertices, faces)
    pose = Pose(TURN, torch.tensor([0.5, 0.0, 0.4], dtype=torch.float64))
    with pytest.raises(InputError, match="box: the camera sees too little"):
        plain.textured_from(np.zeros((256, 256, 3), np.uint8), pose, CAMERA)


def test_a_lens_takes_its_colours_where_the_lens_shows_them() -> None:
    camera = Camera(400, 400, 319.5, 239.5, 640, 480, [-0.25, 0.05, 0, 0])
    assert camera.lens is not None
    vertices, faces, *_ = meshes.box_arrays((0.1, 0.08, 0.06))
    plain = Mesh.from_arrays("box", vertices, faces)
    pose = Pose(TURN, torch.tensor([0.28, 0.18, 0.5], dtype=torch.float64))
    y, x = np.mgrid[:480, :640].astype(np.float64)
    pinhole = camera.lens.undistort(np.column_stack([x.ravel(), y.ravel()]), camera.matrix.numpy())

    def scenery(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        waves = [128 + 100 * np.sin(wave) for wave in (x / 23, y / 31, (x + y) / 40)]
        return np.stack(waves, -1).round().astype(np.uint8)

    taken = scenery(*pinhole.T).reshape(480, 640, 3)
    colours = []
    for image, of in ((taken, camera), (scenery(x, y), camera.pinhole)):
        mesh = plain.textured_from(image, pose, of)
        assert mesh.uv is not None and mesh.texture is not None
        height, width = mesh.texture.shape[:2]
        places = (mesh.uv[mesh.faces].mean(1) * (width, -height) + (0, height)).astype(int)
        colours.append(mesh.texture[places[:, 1], places[:, 0]].astype(float))
    # Looked up in whole pixels; in pixels without the lens they were 45 apart.
    assert np.abs(colours[0] - colours[1]).mean() < 8


def test_where_the_lens_shows_nothing_there_is_nothing_to_take() -> None:
    camera = Camera(300, 300, 127.5, 127.5, 256, 256, [-0.3, 0, 0, 0])  # folds at 46 degrees
    vertices, faces, *_ = meshes.box_arrays()
    plain = Mesh.from_arrays("box", vertices, faces)
    pose = Pose(TURN, torch.tensor([0.9, 0.0, 0.5], dtype=torch.float64))
    pixel = camera.project(pose.translation)
    assert 0 < float(pixel[0]) < 256  # of a point that the lens does not show
    with pytest.raises(InputError, match="box: the camera sees too little"):
        plain.textured_from(np.full((256, 256, 3), 90, np.uint8), pose, camera)


def test_what_is_behind_the_camera_hides_nothing() -> None:
    size = np.array([0.1, 0.08, 0.4])  # reaches past the camera
    vertices, faces, *_ = meshes.box_arrays(tuple(size))
    plate = np.array(
        [[-0.05, -0.05, 0.3], [0.05, -0.05, 0.3], [0.05, 0.05, 0.3], [-0.05, 0.05, 0.3]]
    )
    mesh = Mesh.from_arrays(
        "plate and box",
        np.concatenate([plate, np.asarray(vertices) - (0, 0, 0.3)]),
        np.concatenate([[[0, 1, 2], [0, 2, 3]], np.asarray(faces) + 4]),
    )
    image = np.full((256, 256, 3), (200, 90, 30), np.uint8)
    mesh.textured_from(image, Pose.identity(), CAMERA)


def test_the_name_stays_as_it_is(painted: tuple[Mesh, Mesh, Pose]) -> None:
    true, _, pose = painted
    vertices, faces, *_ = meshes.box_arrays((0.1, 0.08, 0.06))
    named = Mesh.from_arrays("drill.v2", vertices, faces)
    assert (
        named.name == named.textured_from(rendered(true, pose)[0], pose, CAMERA).name == "drill.v2"
    )
