"""Where the objects of a video are when it begins, and what is searched for that."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d import Mesh, Pose
from moveit6d.cli.starting import begin, first_readable
from moveit6d.datasets.video import VideoFrame
from moveit6d.estimation import PoseTracker
from tests.support.clip import Clip

IMAGE = np.zeros((120, 160, 3), np.uint8)


def frames(*read: bool) -> list[VideoFrame]:
    return [VideoFrame(k, f"{k}.png", IMAGE if one else None) for k, one in enumerate(read)]


def at(z: float) -> Pose:
    return Pose(torch.eye(3, dtype=torch.float64), torch.tensor([0, 0, z], dtype=torch.float64))


def options(count: int = 1, **changes: Any) -> Namespace:
    words = dict.fromkeys(("box", "mask", "points", "distance"))
    words |= {"texture_from_start": False, "mesh_unit": ["m"]}
    return Namespace(**{**words, "mesh": [Path(f"{k}.ply") for k in range(count)], **changes})


@pytest.fixture
def plain(brick: Mesh) -> Mesh:
    return Mesh.from_arrays("plain", brick.vertices, brick.faces)


class Detector:
    """Finds what it is told to find, and says what it was asked."""

    def __init__(self, camera: Any, poses: list[Pose]) -> None:
        self.camera, self.poses = camera, poses
        self.asked: list[dict[str, Any]] = []

    def detect(self, image: Any, **known: Any) -> Any:
        self.asked.append(known)
        return SimpleNamespace(pose=self.poses[0] if self.poses else None, probability=0.25)


def test_the_first_frame_that_can_be_read() -> None:
    first, unread, every = first_readable(iter(frames(False, False, True, True)))
    assert first is not None and (first.index, unread) == (2, 2)
    assert [frame.index for frame in every] == [0, 1, 2, 3]
    first, unread, every = first_readable(iter(frames(False)))
    assert first is None and unread == 1 and len(list(every)) == 1


def test_without_need_nothing_is_searched_or_read_ahead(scene: Any, plain: Mesh) -> None:
    def never(mesh: Mesh) -> Any:
        raise AssertionError

    for mesh, args in ((plain, options()), (scene.mesh, options(texture_from_start=True))):
        source = iter(frames(True, True))
        beginning, every = begin(args, [mesh], [None], source, never)
        assert every is source and beginning.starts == [None] and beginning.found == ()


def test_a_mesh_to_be_painted_is_searched_in_the_first_frame(
    scene: Any, plain: Mesh, capsys: Any
) -> None:
    detector = Detector(scene.camera, [at(0.5)])
    args = options(texture_from_start=True)
    beginning, every = begin(args, [plain], [None], iter(frames(True)), lambda _: detector)
    assert beginning.found == (at(0.5),) or beginning.found[0] is detector.poses[0]
    assert beginning.exact == [True] and len(list(every)) == 1
    assert detector.asked == [dict.fromkeys(("box", "mask", "points", "distance"))]
    detector.poses = []
    beginning, _ = begin(args, [plain], [None], iter(frames(True)), lambda _: detector)
    assert beginning.found == (None,) and beginning.exact == [False]
    said = capsys.readouterr().err
    assert "the object is not found in the first frame (probability 0.25)" in said
    known = begin(args, [plain], [None], iter(frames(True)), lambda _: detector, (at(0.4),))[0]
    assert len(detector.asked) == 2 and float(known.starts[0].translation[2]) == 0.4  # type: ignore[union-attr]


def test_in_a_distance_alone_the_tracker_looks_by_itself(scene: Any) -> None:
    def never(mesh: Mesh) -> Any:
        raise AssertionError

    args, source = options(distance=[0.2, 2.0]), iter(frames(True))
    beginning, every = begin(args, [scene.mesh], [None], source, never)
    assert every is source and beginning.starts == [None] and beginning.found == ()


def test_what_is_known_of_a_frame_that_cannot_be_read(scene: Any, plain: Mesh, capsys: Any) -> None:
    detector = Detector(scene.camera, [at(0.5)])
    args = options(box=[1, 2, 30, 40], distance=[0.2, 2])
    source = iter(frames(False, True))
    beginning, every = begin(args, [scene.mesh], [None], source, lambda _: detector)
    said = capsys.readouterr().err
    assert "the first frame cannot be read; frame 1 is searched without --box, which is of" in said
    assert detector.asked == [{"box": None, "mask": None, "points": None, "distance": [0.2, 2]}]
    assert beginning.exact == [True] and [frame.index for frame in every] == [0, 1]
    args = options(distance=[0.2, 2], texture_from_start=True)
    begin(args, [plain], [None], iter(frames(False, True)), lambda _: detector)
    assert "frame 1 is searched instead." in capsys.readouterr().err
    beginning, _ = begin(args, [plain], [None], iter(frames(False)), lambda _: detector)
    assert beginning.starts == [None] and beginning.first is None, "the track says why"


def test_a_given_start_is_not_of_a_later_frame(scene: Any, plain: Mesh) -> None:
    args = options(texture_from_start=True)
    for read, exact in (((True,), [True]), ((False, True), [False]), ((False,), [False])):
        beginning, _ = begin(args, [plain], [at(0.5)], iter(frames(*read)), lambda _: None)  # type: ignore[arg-type, return-value]
        assert beginning.exact == exact and beginning.found == ()


def test_several_are_searched_together_and_where_no_given_one_is(
    scene: Any, plain: Mesh, monkeypatch: pytest.MonkeyPatch, capsys: Any
) -> None:
    asked: list[Any] = []

    def detect(detectors: Any, image: Any, counts: Any, regions: Any) -> Any:
        asked.append((counts, [region.distance for region in regions]))
        asked.append([[float(pose.translation[2]) for pose in one.taken] for one in regions])
        here = [SimpleNamespace(pose=at(0.7)), SimpleNamespace(pose=at(0.8))]
        return [SimpleNamespace(instances=here), SimpleNamespace(instances=[])]

    monkeypatch.setattr("moveit6d.estimation.detection.detect_objects", detect)
    other = Mesh.from_arrays("other", 2 * plain.vertices, plain.faces)
    meshes = [plain, plain, other, plain]
    args = options(4, distance=[0.2, 2.0], texture_from_start=True)
    beginning, _ = begin(
        args, meshes, [None, at(0.3), None, None], iter(frames(True)),
        lambda _: Detector(scene.camera, []),  # type: ignore[arg-type, return-value]
    )  # fmt: skip
    assert asked == [([2, 1], [(0.2, 2.0)] * 2), [[0.3], []]]
    places = [pose and float(pose.translation[2]) for pose in beginning.found]
    assert places == [0.7, 0.3, None, 0.8]
    assert "not found in the first frame, and looked for from there on: 2." in (
        capsys.readouterr().err
    )


BOX = ["--box", "50", "40", "40", "40"]


@pytest.mark.parametrize("option", [BOX, [*BOX, "--distance", "0.3", "1"]])
def test_a_first_frame_that_cannot_be_read_does_not_end_a_track(
    clip: Clip, use_search: Callable[[Pose | None], list[dict[str, Any]]], option: list[str],
    capsys: Any,
) -> None:  # fmt: skip
    asked = use_search(clip.true)
    (clip.folder / "frames" / "000000.png").write_bytes(b"no picture")
    assert clip.search("--no_overlay", *option) == 0
    assert "the first frame cannot be read; frame 1 is searched" in capsys.readouterr().err
    assert asked[0]["box"] is None and (asked[0]["distance"] is None) == (option == BOX)
    assert clip.summary()["states"] == {"uncertain": 1, "tracking": 4}


def test_a_start_that_is_found_is_compared_with_its_half_turns(
    clip: Clip, use_search: Callable[[Pose | None], Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    checked: list[bool] = []
    update = PoseTracker.update

    def watched(self: Any, image: Any) -> Any:
        checked.append(self.supervisors[0].check is not None)
        return update(self, image)

    monkeypatch.setattr(PoseTracker, "update", watched)
    use_search(clip.true)
    assert clip.search("--no_overlay", *BOX) == 0
    assert clip.track("--no_overlay") == 0
    assert checked == [True] * 5 + [False] * 5
