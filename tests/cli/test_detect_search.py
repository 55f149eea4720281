"""Several objects in one image: searched together, instances of one mesh dealt out."""

from __future__ import annotations

from argparse import Namespace
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from moveit6d import Camera, InputError, Mesh, Pose
from moveit6d.cli.common import Setting
from moveit6d.cli.detect_search import check_objects, image_search, known_by
from moveit6d.cli.objects import load_meshes
from moveit6d.estimation.detection import Detection, FoundPose
from moveit6d.estimation.results import StopReason, TrackingResult
from tests.support.clip import write_other

NOTHING = dict.fromkeys(("box", "mask", "points", "distance", "start"))


def found(confidence: float) -> FoundPose:
    pose = Pose.identity()
    return FoundPose(TrackingResult(pose, 1, StopReason.MAX_ITERATIONS, confidence, 1.0))


def options(*meshes: Path, **more: Any) -> Namespace:
    return Namespace(
        mesh=[*meshes], **{
            "mesh_unit": ["m"], "image": [Path("a.png")], "instances": 1, "method": "templates",
            "allow_untextured": False, **NOTHING, **more,
        },
    )  # fmt: skip


@pytest.fixture
def setting() -> Setting:
    return Setting(None, "embree", 1)


def test_objects_share_the_image_and_instances_of_a_mesh_are_dealt_out(
    brick_file: Path, tmp_path: Path, setting: Setting, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "mesh.ply").write_bytes(brick_file.read_bytes())
    can = write_other(tmp_path).rename(tmp_path / "can.ply")
    args = options(brick_file, can, brick_file, instances=2, distance=[0.3, 0.8])
    camera, meshes = Camera(90, 90, 39.5, 29.5, 80, 60), load_meshes(args)
    search = image_search(args, setting, meshes, camera, known_by(args, meshes))
    assert search.names == ["brick_1", "can", "brick_2"]
    asked: list[Any] = []

    def detect(detectors: Any, image: Any, counts: Any, regions: Any) -> list[Detection]:
        asked.append((detectors, image, counts, [region.distance for region in regions]))
        best = tuple(found(confidence) for confidence in (0.9, 0.8, 0.7))
        return [Detection(best, (found(0.1),)), Detection((), (found(0.2),))]

    monkeypatch.setattr("moveit6d.estimation.detection.detect_objects", detect)
    first, second, third = search.detections("image")  # type: ignore[arg-type]
    ((detectors, _, counts, distances),) = asked
    assert [one.mesh for one in detectors] == meshes[:2]
    assert counts == [4, 2] and distances == [(0.3, 0.8)] * 2
    assert [one.probability for one in first.instances] == [0.9, 0.8]
    assert not second.found and second.probability == 0.2
    assert [one.probability for one in third.instances] == [0.7]


def test_a_copy_is_the_same_object_and_one_in_another_unit_is_not(
    brick_file: Path, brick: Mesh, setting: Setting
) -> None:
    larger, copy = replace(brick, vertices=2 * brick.vertices), replace(brick, name="copy")
    args = options(brick_file, brick_file, brick_file)
    camera = Camera(90, 90, 39.5, 29.5, 80, 60)
    search = image_search(args, setting, [brick, larger, copy], camera, NOTHING)
    assert search.groups == [[0, 2], [1]]


def test_what_is_for_one_object_or_one_image_is_refused(capsys: Any) -> None:
    cup = Path("cup.ply")
    for name in ("box", "mask", "points", "start"):
        with pytest.raises(InputError, match=f"--{name} is for one object"):
            check_objects(options(cup, cup, **{name: "given"}))
    check_objects(options(cup, cup, distance=[0.3, 0.8]))
    for more in ({"mesh": [cup, cup]}, {"image": [cup, cup]}):
        args = Namespace(**{**vars(options(cup, method="seeds")), **more})
        with pytest.raises(InputError, match="seeds takes one --mesh and one --image"):
            check_objects(args)
    assert not capsys.readouterr().err
    check_objects(options(cup, points=cup, image=[cup, cup, cup]))
    assert "taken for all 3: object and camera must stand still" in capsys.readouterr().err
