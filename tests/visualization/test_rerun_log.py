"""What the rerun viewer gets: every frame, the object where it is, curves, messages."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.video import VideoFrame
from moveit6d.errors import InputError
from moveit6d.visualization.rerun_log import RerunLog


def test_the_missing_package_is_named(
    scene: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rerun", None)
    with pytest.raises(InputError, match=r"pip install 'moveit6d\[rerun\]'"):
        RerunLog(tmp_path / "run.rrd", scene.mesh, scene.camera)


def read_back(path: Path) -> dict[str, dict[str, dict[int | None, Any]]]:
    """Entity → component → frame (None: always) → value of an .rrd file."""
    chunks = pytest.importorskip("rerun.chunk")
    found: dict[str, dict[str, dict[int | None, Any]]] = {}
    for chunk in chunks.RrdReader(str(path)).stream().to_chunks():
        batch = chunk.to_record_batch()
        frames = batch.column("frame").to_pylist() if not chunk.is_static else [None]
        for name in batch.schema.names:
            if ":" in name:
                place = found.setdefault(chunk.entity_path, {}).setdefault(name, {})
                place |= dict(zip(frames, batch.column(name).to_pylist(), strict=True))
    return found


@pytest.mark.filterwarnings("ignore")
def test_everything_of_a_run_is_in_the_file(scene: Any, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    path = tmp_path / "deep" / "run.rrd"
    truth = {frame: scene.pose(frame) for frame in range(4)}
    poses = [scene.pose(0), None, None, scene.pose(3)]
    with RerunLog(path, scene.mesh, scene.camera, truth) as log:
        for number, pose in enumerate(poses):
            image = scene.image(number) if number != 1 else None
            row = PoseRow(
                number, pose=pose, iterations=4, confidence=0.25 * number, reset=number == 3
            )
            log.write(VideoFrame(number, "", image), row, "damaged" if number == 1 else None)
        assert not path.exists(), "the file appears when it is whole"
    assert [file.name for file in path.parent.iterdir()] == ["run.rrd"]
    found = read_back(path)
    place = found["/camera/object"]["Transform3D:translation"]
    assert sorted(place) == [0, 3]
    np.testing.assert_allclose(place[3][0], scene.pose(3).translation, atol=1e-6)
    turn = np.reshape(found["/camera/object"]["Transform3D:mat3x3"][3][0], (3, 3)).T
    np.testing.assert_allclose(turn, scene.pose(3).rotation, atol=1e-6)  # stored by columns
    surface = found["/camera/object"]["Mesh3D:vertex_positions"]
    assert sorted(surface) == [0, 3], "taken away in frame 1, shown again in frame 3"
    expected = scene.mesh.vertices + scene.mesh.center  # the file's own frame, as the poses
    np.testing.assert_allclose(surface[0], expected, atol=1e-6)
    assert sorted(found["/camera/truth"]["Transform3D:translation"]) == [0, 1, 2, 3]
    curve = found["/curves/confidence"]["Scalars:scalars"]
    assert {frame: value[0] for frame, value in curve.items()} == {0: 0, 1: 0.25, 2: 0.5, 3: 0.75}
    assert found["/curves/origin_error_mm"]["Scalars:scalars"] == {0: [0.0], 3: [0.0]}
    said = found["/messages"]["TextLog:text"]
    assert said == {1: ["damaged"], 3: ["set to the true pose"]}
    pictures = found["/camera/image"]["EncodedImage:blob"]
    assert sorted(pictures) == [0, 2, 3]
    lens = np.reshape(found["/camera/image"]["Pinhole:image_from_camera"][None][0], (3, 3)).T
    np.testing.assert_allclose(lens, scene.camera.matrix, rtol=1e-6)


@pytest.mark.filterwarnings("ignore")
def test_a_frame_without_a_picture_or_a_true_pose_shows_none(scene: Any, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    path, truth = tmp_path / "run.rrd", {0: scene.pose(0), 2: scene.pose(2)}
    with RerunLog(path, scene.mesh, scene.camera, truth) as log:
        for number in range(3):
            image = scene.image(number) if number != 1 else None
            log.write(VideoFrame(number, "", image), PoseRow(number))
    found = read_back(path)
    for place in ("/camera/image", "/camera/truth"):
        assert list(found[place]["Clear:is_recursive"]) == [1], place
    # A `Clear` at a time takes away nothing that is logged as static.
    assert sorted(found["/camera/truth"]["Boxes3D:centers"]) == [0, 2]


@pytest.mark.filterwarnings("ignore")
def test_two_runs_are_two_recordings(scene: Any, tmp_path: Path) -> None:
    chunks = pytest.importorskip("rerun.chunk")
    names = set()
    for folder in ("a", "b"):
        with RerunLog(tmp_path / folder / "run.rrd", scene.mesh, scene.camera) as log:
            log.write(VideoFrame(0, "", scene.image(0)), PoseRow(0))
        reader = chunks.RrdReader(str(tmp_path / folder / "run.rrd"))
        names |= {one.recording_id for one in reader.recordings()}
    assert len(names) == 2 and all(name.startswith("run ") for name in names)


@pytest.mark.filterwarnings("ignore")
def test_a_frame_of_another_size_is_not_shown(scene: Any, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    path = tmp_path / "run.rrd"
    lens = replace(scene.camera, distortion=(0.1, 0.0, 0.0, 0.0, 0.0))
    with RerunLog(path, scene.mesh, lens) as log:
        for number, size in enumerate([(120, 160), (60, 80), (120, 160)]):
            image = np.zeros((*size, 3), np.uint8)
            log.write(VideoFrame(number, "", image), PoseRow(number, confidence=0.5))
    found = read_back(path)
    assert sorted(found["/camera/image"]["EncodedImage:blob"]) == [0, 2]
    assert sorted(found["/curves/confidence"]["Scalars:scalars"]) == [0, 1, 2]


@pytest.mark.filterwarnings("ignore")
def test_without_a_frame_an_older_file_stays(scene: Any, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    (tmp_path / "run.rrd").write_text("older")
    for name in ("run.rrd", "new.rrd"):
        with RerunLog(tmp_path / name, scene.mesh, scene.camera):
            pass
    assert {path.name: path.read_text() for path in tmp_path.iterdir()} == {"run.rrd": "older"}


@pytest.mark.filterwarnings("ignore")
def test_ctrl_c_leaves_a_whole_file(scene: Any, tmp_path: Path) -> None:
    pytest.importorskip("rerun")
    path = tmp_path / "run.rrd"
    with pytest.raises(KeyboardInterrupt), RerunLog(path, scene.mesh, scene.camera) as log:
        log.write(VideoFrame(0, "", None), PoseRow(0, pose=scene.pose(0), iterations=2))
        raise KeyboardInterrupt
    assert read_back(path)["/curves/iterations"]["Scalars:scalars"] == {0: [2.0]}
    with pytest.raises(InputError, match="cannot be written"):
        RerunLog(path / "below" / "a.rrd", scene.mesh, scene.camera).__enter__()
