"""Readers and writers take paths as text, too."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.datasets import bop_sequences, laval, mesh_writers, rbot, sequences, video, ycbv
from moveit6d.datasets.bop import BopDataset, Estimate, Instance, read_results, write_results
from moveit6d.datasets.bop_boxes import read_boxes
from moveit6d.datasets.bop_writer import BopImage, write_bop
from moveit6d.datasets.catalog import recognise
from moveit6d.datasets.pose_files import (
    PoseRow,
    PoseWriter,
    read_camera,
    read_poses,
    whole_lines,
    write_camera,
    write_poses,
)
from moveit6d.estimation.detection.points import read_points
from moveit6d.evaluation.sequence_scores import confidences, score_results
from moveit6d.evaluation.track_files import read_tracks
from moveit6d.evaluation.track_scores import read_track
from moveit6d.evaluation.ycbv import keyframes
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from tests.support.malformed import good_files

FILES = {kind: files for kind, _, files, _ in good_files()}
READERS: dict[str, tuple[str, str, Callable[[Any], Any]]] = {
    "read_poses": ("csv", "poses.csv", read_poses),
    "whole_lines": ("csv", "poses.csv", whole_lines),
    "read_track": ("csv", "poses.csv", read_track),
    "read_camera": ("camera", "camera.json", read_camera),
    "read_results": ("results", "r.csv", read_results),
    "read_image": ("image", "a.tif", video.read_image),
    "image_size": ("image", "a.tif", video.image_size),
    "first_size": ("image", "a.tif", lambda path: video.first_size([path])),
    "ImageList": ("image", "a.tif", lambda path: video.ImageList([path]).frame(0).image.shape),  # type: ignore[union-attr]
    "recognise": ("bop", "", recognise),
    "BopDataset": ("bop", "", lambda path: BopDataset(path, "test").scenes()),
    "read_bop_sequences": ("bop", "", bop_sequences.read_bop_sequences),
    "read_laval": ("laval", "", laval.read_laval),
    "laval.read_camera": ("laval", "dog_occlusion_0/camera.json", laval.read_camera),
    "read_ycbv": ("ycbv", "", ycbv.read_ycbv),
    "read_keyframes": ("ycbv", "", ycbv.read_keyframes),
    "object_names": ("ycbv", "", ycbv.object_names),
    "read_meta": ("ycbv", "data/0048/000001-meta.mat", ycbv.read_meta),
    "read_rbot": ("rbot", "", rbot.read_rbot),
    "is_rbot": ("rbot", "", rbot.is_rbot),
}


@pytest.mark.parametrize("name", READERS)
def test_a_reader_takes_text(name: str, tmp_path: Path) -> None:
    kind, place, read = READERS[name]
    for file, content in FILES[kind].items():
        (tmp_path / file).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / file).write_bytes(content)
    said, wanted = (repr(read(kind(tmp_path / place))) for kind in (str, Path))
    assert said == wanted and said not in ("None", "[]")


def test_a_sequence_folder_as_text(make_sequence: Callable[..., Any]) -> None:
    made = make_sequence()
    folder = str(made.folder)
    assert sequences.is_sequence(folder)
    (one,) = sequences.read_sequence(folder)
    (same,) = sequences.read_sequences(folder)
    assert one.name == same.name == "easy_00" and one.folder == made.folder
    assert score_results([one], folder)["easy_00"].below_5 == 1.0
    assert len(confidences(read_tracks([one], folder))[0]) == 0


def test_boxes_points_and_keyframes_as_text(tmp_path: Path) -> None:
    found = {"scene_id": 1, "image_id": 2, "category_id": 3, "bbox": [1, 2, 3, 4], "score": 1}
    (tmp_path / "boxes.json").write_text(json.dumps([found]))
    assert read_boxes(str(tmp_path / "boxes.json")) == {(1, 2, 3): [(1, 2, 3, 4)]}
    (tmp_path / "points.csv").write_text("10,20,0.1,0,0\n90,20,0,0.1,0\n")
    assert read_points(str(tmp_path / "points.csv"), "m").shape == (2, 5)
    pose = Pose.stack([Pose.from_rvec([0, 0, 0], [0, 0, 0.5])])
    listed = keyframes.Keyframes(torch.tensor([1]), ("mug",), pose, {"a": pose})
    keyframes.write_keyframe_poses(str(tmp_path / "poses.npz"), listed)
    assert keyframes.read_keyframe_poses(str(tmp_path / "poses.npz")).names == ("mug",)
    np.savez(tmp_path / "points.npz", **{"01": np.zeros((2, 3))})
    assert keyframes.read_points(str(tmp_path / "points.npz"))[1].shape == (2, 3)


def test_writers_take_text(brick: Mesh, tmp_path: Path) -> None:
    camera, pose = Camera(180.0, 182.0, 78.0, 61.0, 160, 120), Pose.from_rvec([0, 0, 0], [0, 0, 1])
    picture = np.zeros((120, 160, 3), np.uint8)
    folder = str(tmp_path / "new")
    write_camera(f"{folder}/camera.json", camera)
    camera.save(f"{folder}/saved.json")
    assert Camera.load(f"{folder}/saved.json") == read_camera(f"{folder}/camera.json") == camera
    write_poses(f"{folder}/poses.csv", [PoseRow(3, pose=pose)])
    with PoseWriter(f"{folder}/rows.csv") as table:
        table.write(PoseRow(3, pose=pose))
    for name in ("poses.csv", "rows.csv"):
        assert [row.frame for row in read_poses(f"{folder}/{name}")] == [3]
    write_results(f"{folder}/results.csv", [Estimate(1, 2, 3, 0.5, pose)])
    assert read_results(f"{folder}/results.csv")[0].object == 3
    mesh_writers.write_ply(f"{folder}/mesh.ply", brick)
    mesh_writers.write_obj(f"{folder}/mesh.obj", brick)
    for name in ("mesh.ply", "mesh.obj"):
        assert Mesh.load(f"{folder}/{name}").diameter == pytest.approx(brick.diameter)
    image = BopImage(1, 4, picture, camera, [Instance(3, pose)], None)
    write_bop(f"{folder}/bop", "test", {3: brick}, [image])
    laval.write_laval_sequence(
        f"{folder}/laval", "dog_occlusion_0", brick, camera, [(picture, pose)]
    )
    rbot.write_rbot(f"{folder}/rbot", "cat", brick, camera, [(picture, pose)])
    ycbv.write_ycbv_scene(f"{folder}/ycbv", 48, {1: brick}, camera, [(picture, {1: pose})])
    for kind in ("bop", "laval", "rbot", "ycbv"):
        assert recognise(f"{folder}/{kind}") == kind
