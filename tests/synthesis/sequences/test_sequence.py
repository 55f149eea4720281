"""Sequences: the files, their truth, what is covered, and levels as promised."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from moveit6d.datasets.pose_files import read_camera
from moveit6d.datasets.sequences import read_sequences
from moveit6d.errors import InputError
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.symmetry import Symmetries
from moveit6d.rendering.backends import make_renderer
from moveit6d.synthesis.imaging.shading import ShadedSurface
from moveit6d.synthesis.objects.demo_object import demo_object
from moveit6d.synthesis.objects.occluders import random_occluder
from moveit6d.synthesis.objects.shapes import random_object
from moveit6d.synthesis.sequences.difficulty import DIFFICULTIES, Difficulty
from moveit6d.synthesis.sequences.occlusion import visible_fraction
from moveit6d.synthesis.sequences.sequence import Scene, write_sequence

SMALL = Camera(205.0, 205.0, 106.0, 79.5, 213, 160)


@pytest.fixture(scope="module")
def robot() -> Mesh:
    return demo_object()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory, robot: Mesh) -> Path:
    place = tmp_path_factory.mktemp("made") / "medium_00"
    return write_sequence(place, mesh=robot, seed=3, frames=14, difficulty="medium", camera=SMALL)


def test_folder_holds_what_trackers_read(folder: Path) -> None:
    (sequence,) = read_sequences(folder)
    assert sequence.level == "medium"
    assert sequence.camera == SMALL == read_camera(folder / "camera.json")
    assert sorted(sequence.truth) == list(range(14))
    assert len(list((folder / "frames").glob("*.jpg"))) == 14
    start, first = Pose.load(folder / "start.json"), sequence.truth[0]
    torch.testing.assert_close(start.rotation, first.rotation, atol=1e-7, rtol=0)
    torch.testing.assert_close(start.translation, first.translation, atol=1e-7, rtol=0)
    info = json.loads((folder / "info.json").read_text())
    assert info["frames"] == 14 and info["seed"] == 3


def test_declared_symmetries_go_along(folder: Path, tmp_path: Path, robot: Mesh) -> None:
    assert not (folder / "mesh.symmetry.json").exists()
    declared = Symmetries.from_bop({"symmetries_continuous": [{"axis": [0, 1, 0]}]})
    made = write_sequence(
        tmp_path / "made", mesh=replace(robot, symmetries=declared), seed=3, frames=2, camera=SMALL
    )
    (sequence,) = read_sequences(made)
    (axis,) = sequence.load_mesh().symmetries.continuous
    assert sequence.symmetric and axis.axis.tolist() == [0, 1, 0]


def test_mesh_file_is_the_object(folder: Path, robot: Mesh) -> None:
    back = Mesh.load(folder / "mesh.glb", "m")
    np.testing.assert_allclose(back.center, robot.center, atol=1e-5)
    assert back.diameter == pytest.approx(robot.diameter, rel=1e-5)
    assert back.texture is not None and robot.texture is not None
    np.testing.assert_array_equal(back.texture, robot.texture)
    np.testing.assert_allclose(
        np.sort(back.vertices, axis=0), np.sort(robot.vertices, axis=0), atol=1e-5
    )


def test_columns_of_the_truth(folder: Path) -> None:
    with (folder / "poses.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert rows[5]["image"] == "frames/000005.jpg"
    seen = np.array([float(row["visible_fraction"]) for row in rows])
    assert ((seen > 0.3) & (seen <= 1.0)).all()


def test_same_seed_same_pictures(robot: Mesh) -> None:
    def picture() -> np.ndarray:
        return Scene(robot, 5, 10, "easy", camera=SMALL).render_frame(4).image

    np.testing.assert_array_equal(picture(), picture())


@pytest.mark.parametrize("seed", range(3))
def test_truth_is_where_the_object_is_seen(
    seed: int, robot: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Glowing and still in front of black: the picture is the true silhouette, soft at its edge.
    def brightness(surface: ShadedSurface, *_: object) -> torch.Tensor:
        return torch.ones_like(surface.albedo)

    monkeypatch.setattr("moveit6d.synthesis.sequences.layers.shade", brightness)
    still = Difficulty("still", (1e-3, 2e-3), (1e-3, 2e-3), shutter=(0.01, 0.02), clutter=(0, 0))
    scene = Scene(robot, seed, 4, still, camera=SMALL, photos=[np.zeros((80, 100, 3), np.uint8)])
    frame = scene.render_frame(1)
    inner = robot.inner(frame.pose)
    batch = Pose(inner.rotation[None], inner.translation[None])
    mask = make_renderer("embree").render([robot], batch, SMALL.matrix[None], 213).mask[0, 0]
    expected = mask.numpy()[:160] > 0.5
    occluded = (frame.image[..., 1] / 255) ** 2.2
    occluded[occluded < 0.03] = 0.0  # noise
    bright = occluded > 0.5
    assert (bright & expected).sum() / (bright | expected).sum() > 0.95
    assert occluded.sum() == pytest.approx(expected.sum(), rel=0.03)
    place = np.argwhere(occluded > 0)
    middle = np.average(place, axis=0, weights=occluded[tuple(place.T)])
    np.testing.assert_allclose(middle, np.argwhere(expected).mean(0), atol=0.1)  # pixels


def test_blur_is_centred_on_the_true_pose(robot: Mesh) -> None:
    # Half of the motion lies before and half after the true pose.
    fast = replace(DIFFICULTIES["fast"], clutter=(0, 0), shutter=(0.5, 0.5))
    scene = Scene(robot, 2, 30, fast, camera=SMALL)
    for number in (5, 12, 20):
        times, offsets = scene._samples(number)
        assert times.mean() == pytest.approx(number)
        np.testing.assert_allclose(offsets.mean(0), 0, atol=1e-12)
        assert np.ptp(times) < 0.5
        middle = scene.motion.pixel(times)[:, :2].mean(0)
        assert np.linalg.norm(middle - scene.motion.pixel(np.asarray(number))[:2]) < 0.3


@pytest.mark.parametrize("seed", range(3))
def test_covering_is_as_the_level_says(seed: int) -> None:
    mesh = random_object(np.random.default_rng(seed))
    scene = Scene(mesh, seed, 40, "occ", camera=SMALL)
    seen = np.array(
        [
            visible_fraction(scene._renderer, mesh, scene.motion, scene.occluders, k)
            for k in range(40)
        ]
    )
    assert 0.15 < (seen < 0.98).mean() < 0.75
    assert 0.45 < seen.min() < 0.9


def test_easy_and_fast_are_never_covered(robot: Mesh) -> None:
    for name in ("easy", "fast"):
        assert Scene(robot, 1, 30, name, camera=SMALL).occluders == []


def test_hard_light_changes_and_easy_light_does_not(robot: Mesh) -> None:
    def spread(name: str) -> float:
        scene = Scene(robot, 4, 60, name, camera=SMALL)
        keys = [scene._light(k)[0].key[1] * scene._light(k)[1] for k in range(0, 60, 4)]
        return max(keys) / min(keys)

    assert spread("easy") < 1.15
    assert spread("hard") > 1.3


@pytest.mark.parametrize("seed", range(6))
def test_occluders_are_meshes_of_the_asked_scale(seed: int) -> None:
    small = random_occluder(np.random.default_rng(seed), 0.5)
    large = random_occluder(np.random.default_rng(seed), 1.0)
    assert large.mesh.sphere_diameter == pytest.approx(2 * small.mesh.sphere_diameter, rel=0.05)
    assert 0.05 < large.mesh.sphere_diameter < 0.6


def test_photos_are_used(robot: Mesh) -> None:
    blue = np.full((60, 80, 3), (10, 20, 230), np.uint8)
    image = Scene(robot, 1, 4, "easy", [blue], SMALL).render_frame(0).image
    assert np.median(image.reshape(-1, 3), axis=0) == pytest.approx([10, 20, 230], abs=40)


def test_an_older_sequence_is_replaced(tmp_path: Path, robot: Mesh) -> None:
    place = tmp_path / "clip"
    for frames in (4, 2):
        write_sequence(place, mesh=robot, seed=1, frames=frames, difficulty="easy", camera=SMALL)
    assert len(list((place / "frames").iterdir())) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["clip"]


def test_other_folders_are_left_alone(tmp_path: Path, robot: Mesh) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")
    with pytest.raises(InputError, match="not a sequence made here"):
        write_sequence(tmp_path, mesh=robot, seed=1, frames=2)
    assert (tmp_path / "thesis.txt").read_text() == "years of work"


def test_what_lies_beside_an_older_sequence_is_not_removed_with_it(
    tmp_path: Path, robot: Mesh
) -> None:
    place = tmp_path / "clip"
    options = {"mesh": robot, "seed": 1, "frames": 2, "difficulty": "easy", "camera": SMALL}
    write_sequence(place, **options)
    (place / "overlay.mp4").write_text("a track of it")
    (place / "frames" / "mask.png").write_text("mine")
    with pytest.raises(InputError, match=r"clip holds frames/mask\.png, overlay\.mp4 beside a seq"):
        write_sequence(place, **options)
    assert (place / "overlay.mp4").read_text() == "a track of it"


def test_interrupted_writing_leaves_nothing(tmp_path: Path, robot: Mesh) -> None:
    def stop(number: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_sequence(tmp_path / "clip", mesh=robot, seed=1, frames=3, camera=SMALL, on_frame=stop)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("difficulty", "frames"), [("impossible", 10), ("easy", 1)])
def test_bad_requests_are_said(tmp_path: Path, robot: Mesh, difficulty: str, frames: int) -> None:
    with pytest.raises(InputError, match=r"difficulty|frames"):
        write_sequence(tmp_path / "clip", mesh=robot, seed=1, frames=frames, difficulty=difficulty)


def test_a_lens_is_refused_as_it_is_not_rendered(robot: Mesh, tmp_path: Path) -> None:
    lens = replace(SMALL, distortion=(-0.3, 0.1, 0.0, 0.0))
    with pytest.raises(InputError, match=r"rendered without a lens, .* give camera\.pinhole"):
        write_sequence(tmp_path / "clip", mesh=robot, seed=1, frames=2, camera=lens)
    assert not (tmp_path / "clip").exists()
    Scene(robot, 1, 2, "easy", camera=replace(SMALL, distortion=(0.0, 0.0, 0.0, 0.0)))
