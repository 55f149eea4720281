"""Meshes without colours take them from the start, or from the first frame they are tracked in."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import torch

from moveit6d import InputError, Mesh, OraclePolicy, Pose, PoseTracker
from moveit6d.cli.painting import FACT, Painting
from moveit6d.cli.starting import Beginning
from moveit6d.config import TextureConfig
from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.video import VideoFrame
from moveit6d.rendering.backends import make_renderer
from tests.support.clip import Clip


@pytest.fixture
def plain(scene: Any) -> Mesh:
    """The brick without its colours, in the same frame."""
    return Mesh.from_arrays("plain", scene.mesh.vertices + scene.mesh.center, scene.mesh.faces)


def painting(scene: Any, *meshes: Mesh, names: tuple[str, ...] = ("",)) -> Painting:
    return Painting(list(meshes), names, scene.camera, TextureConfig(), True)


def following(scene: Any, *meshes: Mesh) -> Any:
    poses = [scene.pose(0)] * len(meshes)
    target = OraclePolicy(Pose.stack([meshes[0].inner(scene.pose(0))] * len(meshes)))
    return PoseTracker(list(meshes), scene.camera, poses, policy=target, renderer=make_renderer())


def out_of_sight() -> Pose:
    return Pose(torch.eye(3, dtype=torch.float64), torch.tensor([5.0, 0, 0.5]).double())


def test_a_mesh_is_painted_where_its_pose_is_known(scene: Any, plain: Mesh, capsys: Any) -> None:
    first = VideoFrame(3, "", scene.image(0))
    paint = painting(scene, plain)
    assert paint.kept == {FACT: {"frame": None, "reason": "the object was never tracked."}}
    tracker = following(scene, plain)
    paint.begin(tracker, Beginning([scene.pose(0)], [True], (), first))
    (mesh,) = tracker.meshes
    assert mesh.has_colours and paint.kept == {FACT: {"frame": 3}} and not paint.waiting
    paint.end()
    assert capsys.readouterr().err == ""
    coloured = painting(scene, scene.mesh)
    tracker = following(scene, scene.mesh)
    coloured.begin(tracker, Beginning([None], [False]))
    assert tracker.meshes == [scene.mesh] and coloured.kept == {}


def test_too_little_of_a_mesh_to_paint(scene: Any, plain: Mesh, capsys: Any) -> None:
    first, start = VideoFrame(0, "", scene.image(0)), out_of_sight()
    tracker = following(scene, plain)
    with pytest.raises(InputError, match="too little of it"):
        painting(scene, plain).begin(tracker, Beginning([start], [True], (), first))
    paint = painting(scene, plain)
    paint.begin(tracker, Beginning([start], [True], (start,), first))
    assert "too little of it" in paint.kept[FACT]["reason"]
    paint.end()
    assert "the mesh was not painted: plain: the camera sees too little" in capsys.readouterr().err


def test_another_is_painted_once_it_is_tracked(scene: Any, plain: Mesh, capsys: Any) -> None:
    target = Pose.stack([plain.inner(scene.pose(0))] * 2)
    other = Mesh.from_arrays("other", plain.vertices + plain.center, plain.faces)
    paint = painting(scene, plain, other, names=("plain", "other"))
    tracker: Any = PoseTracker(
        [plain, other], scene.camera, [scene.pose(0)] * 2, policy=OraclePolicy(target),
        renderer=make_renderer(),
    )  # fmt: skip
    paint.begin(tracker, Beginning([scene.pose(0)] * 2, [False, False]))
    assert [mesh.has_colours for mesh in tracker.meshes] == [False, False]
    assert "plain: --texture_from_start: the pose in the first frame is" in capsys.readouterr().err
    frame, pose = VideoFrame(7, "", scene.image(0)), scene.pose(0)
    tracker.update(frame.image)
    before, kept = tracker.tracks[0], tracker.supervisors[1]
    lost = PoseRow(7, state="lost")
    for rows in (
        [lost, lost],
        [PoseRow(7, pose=pose, state="uncertain"), lost],
        [PoseRow(7, pose=out_of_sight(), state="tracking"), lost],
    ):
        paint.see(tracker, frame, rows)
    assert not tracker.meshes[0].has_colours
    assert "too little of it" in paint.kept[FACT]["plain"]["reason"]
    paint.see(tracker, frame, [PoseRow(7, pose=pose, state="tracking"), lost])
    assert tracker.meshes[0].has_colours and tracker.tracks[0].mesh is tracker.meshes[0]
    assert tracker.tracks[0].centred is before.centred, "its way stays"
    assert not tracker.meshes[1].has_colours and tracker.supervisors[1] is kept
    never = {"frame": None, "reason": "the object was never tracked."}
    assert paint.kept == {FACT: {"plain": {"frame": 7}, "other": never}}
    tracker.update(frame.image)
    paint.end()
    said = capsys.readouterr().err
    assert "plain: frame 7: the mesh is painted from here." in said
    assert "other: the mesh was not painted: the object was never tracked." in said


def test_instances_stay_so_whatever_each_is_painted_with(
    clip: Clip, plain_file: str, scene: Any, use_oracle: Callable[..., None],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    use_oracle(scene.mesh, clip.true, targets=2)
    known: list[Any] = []
    update = PoseTracker.update

    def watched(self: Any, image: Any) -> Any:
        known.append(([mesh.has_colours for mesh in self.meshes], self._same))
        return update(self, image)

    monkeypatch.setattr(PoseTracker, "update", watched)
    start = str(clip.folder / "start.json")
    scene.pose(3).save(clip.folder / "beside.json")
    assert clip.search(
        "--mesh", plain_file, "--start", start, "--start", str(clip.folder / "beside.json"),
        "--no_overlay", "--no_recovery", "--texture_from_start", mesh=plain_file,
    ) in (0, 3)  # fmt: skip
    assert known[0] == ([True, True], [[1], [0]])


@pytest.fixture
def plain_file(clip: Clip, plain: Mesh) -> str:
    """The brick without its colours, on disk."""
    rows = [f"v {x} {y} {z}" for x, y, z in plain.vertices + plain.center]
    rows += [f"f {a} {b} {c}" for a, b, c in plain.faces + 1]
    path: Path = clip.folder / "plain.obj"
    path.write_text("\n".join(rows))
    return str(path)


def test_what_a_search_finds_is_painted_there(
    clip: Clip, plain_file: str, use_search: Callable[[Pose | None], list[dict[str, Any]]]
) -> None:
    asked = use_search(clip.true)
    assert clip.search("--no_overlay", "--texture_from_start", mesh=plain_file) == 0
    assert len(asked) == 1 and clip.summary()[FACT] == {"frame": 0}
    assert clip.summary()["found_start"]["translation"] == clip.true.translation.tolist()


def test_a_start_of_a_frame_that_cannot_be_read_is_painted_later(
    clip: Clip, plain_file: str, interrupt_update: Callable[[int], None],
    monkeypatch: pytest.MonkeyPatch, capsys: Any,
) -> None:  # fmt: skip
    (clip.folder / "frames" / "000000.png").write_bytes(b"no picture")
    interrupt_update(4)
    options = ("--no_overlay", "--no_recovery", "--texture_from_start")
    assert clip.track(*options, mesh=plain_file) == 130
    assert clip.summary()[FACT] == {"frame": 1}
    assert "frame 1: the mesh is painted from here." in capsys.readouterr().err
    monkeypatch.undo()
    followed: list[bool] = []
    update = PoseTracker.update

    def watched(self: Any, image: Any) -> Any:
        followed.append(self.meshes[0].has_colours)
        return update(self, image)

    monkeypatch.setattr(PoseTracker, "update", watched)
    assert clip.track(*options, "--resume", mesh=plain_file) in (0, 3)
    assert followed == [True, True], "painted again from the same frame"
    assert clip.summary()[FACT] == {"frame": 1} and clip.summary()["frames"] == 5
