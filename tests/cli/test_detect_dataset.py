"""`moveit6d detect --dataset`: a line for every target."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch

from moveit6d.cli.main import main
from moveit6d.datasets.bop import BopDataset, BopTarget, Estimate, Instance, read_results
from moveit6d.datasets.bop_writer import BopImage, write_bop
from moveit6d.estimation import PoseDetector
from moveit6d.estimation.detection import Detection
from moveit6d.policies import SHIPPED_WEIGHTS


def near(found: Any, true: Any) -> bool:
    return float((found.translation - true.translation).norm()) < 0.01


@pytest.fixture
def looked_at(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, float]]:
    """Images whose targets are found at once where they are not damaged, and the mesh's diameter.

    Ctrl-C where that of image 5 is looked at for the first time.
    """
    seen: list[tuple[int, float]] = []

    def detect(dataset: BopDataset, targets: list[BopTarget], *_: Any) -> list[Estimate]:
        one = targets[0]
        seen.append((one.image, dataset.mesh(7).diameter))
        if one.image == 5 and [number for number, _ in seen].count(5) == 1:
            raise KeyboardInterrupt
        dataset.image(one.scene, one.image)
        (truth,) = dataset.truth(one.scene, one.image)
        return [Estimate(one.scene, one.image, 7, 0.9, truth.pose, 0.1)]

    monkeypatch.setattr("moveit6d.cli.detect_dataset.detect_image", detect)
    return seen


@pytest.fixture
def root(tmp_path: Path, scene: Any) -> Path:
    """Images 0, 3, 5 and 6, of which 3 is damaged."""
    images = [
        BopImage(1, number, scene.image(number), scene.camera, [Instance(7, scene.pose(number))])
        for number in (0, 3, 5, 6)
    ]
    folder = write_bop(tmp_path / "set", "test", {7: scene.mesh}, images)
    damage(folder, 3)
    return folder


def damage(root: Path, image: int) -> None:
    (path,) = (root / "test" / "000001" / "rgb").glob(f"{image:06d}.*")
    path.write_bytes(path.read_bytes()[:200])


def words(root: Path, *more: str) -> list[str]:
    out = str(root.parent / "results.csv")
    return ["detect", "--dataset", str(root), "--split", "test", "--output", out, *more]


def test_an_image_that_cannot_be_used_stops_no_others_and_no_resuming(
    root: Path, looked_at: list[tuple[int, float]], capsys: Any
) -> None:
    assert main(words(root)) == 130
    assert "image 3 of scene 1: " in capsys.readouterr().err
    assert main(words(root, "--resume")) == 0
    assert "3 poses in 4 images" in capsys.readouterr().out
    assert [image for image, _ in looked_at] == [0, 3, 5, 5, 6], "none is looked at again"
    found = read_results(root.parent / "results.csv")
    assert [one.image for one in found] == [0, 5, 6]


def test_only_what_poses_depend_on_ties_a_resumed_run(
    root: Path, looked_at: list[tuple[int, float]], tmp_path: Path, capsys: Any
) -> None:
    assert main(words(root)) == 130
    weights = tmp_path / "elsewhere" / "same.safetensors"
    weights.parent.mkdir()
    weights.write_bytes(SHIPPED_WEIGHTS.read_bytes())
    assert main(words(root, "--resume", "--detection.accepted", "0.7")) == 2
    assert "another config" in capsys.readouterr().err
    assert main(words(root, "--resume", "-q", "--threads", "2", "--weights", str(weights))) == 0


def test_as_many_threads_as_asked_search(root: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seen: list[int | None] = []

    def search(detectors: list[PoseDetector], *_: Any) -> list[Detection]:
        seen.extend(one.threads for one in detectors)
        return [Detection((), ()) for _ in detectors]

    monkeypatch.setattr("moveit6d.estimation.detection.detect_objects", search)
    monkeypatch.setattr(PoseDetector, "prepare", lambda self: None)
    main(words(root, "--threads", "2"))
    assert seen == [2, 2, 2], "of the images that can be read"


def test_images_none_of_which_can_be_used_are_bad_input(
    root: Path, looked_at: list[tuple[int, float]], capsys: Any
) -> None:
    for image in (0, 5, 6):
        damage(root, image)
    looked_at.append((5, 0.0))  # no Ctrl-C
    assert main(words(root)) == 2
    said = capsys.readouterr().err
    assert "no image could be used; the first says: image 0 of scene 1: " in said
    assert not (root.parent / "results.csv.unfinished").exists()


def test_the_models_may_have_another_unit(
    root: Path, looked_at: list[tuple[int, float]], capsys: Any
) -> None:
    assert main(words(root)) == 130
    assert main(words(root, "--resume", "--mesh_unit", "cm")) == 2
    assert "another mesh_unit" in capsys.readouterr().err
    assert main(words(root, "--mesh_unit", "cm")) == 0
    assert looked_at[-1][1] == pytest.approx(10 * looked_at[0][1])


@pytest.mark.parametrize(
    "more",
    [
        ["--box", "0", "0", "9", "9"],
        ["--instances", "2"],
        ["--allow_untextured"],
        ["--method", "seeds"],
        ["--sinks", "2"],
        ["--seeds.spacing", "0.5"],
    ],
)
def test_what_is_for_images_alone_is_refused(
    root: Path, looked_at: list[tuple[int, float]], more: list[str], capsys: Any
) -> None:
    assert main(words(root, *more)) == 2
    assert f"{more[0]} is not for --dataset." in capsys.readouterr().err
    assert not looked_at


def test_a_distance_that_cannot_be_is_said_before_the_work(
    root: Path, looked_at: list[tuple[int, float]], capsys: Any
) -> None:
    assert main(words(root, "--distance", "2", "1")) == 2
    assert "nearer first" in capsys.readouterr().err and not looked_at


def test_every_target_of_a_data_set_gets_a_line(tmp_path: Path, scene: Any, capsys: Any) -> None:
    images = [
        BopImage(1, number, scene.image(number), scene.camera, [Instance(7, scene.pose(number))])
        for number in (0, 3)
    ]
    root = write_bop(tmp_path / "set", "test", {7: scene.mesh}, images)
    out = tmp_path / "results.csv"
    command = ["detect", "--dataset", str(root), "--split", "test", "--output", str(out)]
    assert main([*command, "--targets", "test_targets_bop19.json"]) == 0
    assert "2 poses in 2 images" in capsys.readouterr().out
    found = read_results(out)
    assert [(e.scene, e.image, e.object) for e in found] == [(1, 0, 7), (1, 3, 7)]
    assert all(near(e.pose, scene.pose(e.image)) and e.score > 0.5 for e in found)
    assert found[0].seconds > 0


def test_with_boxes_only_they_are_looked_into(tmp_path: Path, scene: Any, capsys: Any) -> None:
    vertices = torch.from_numpy(scene.mesh.vertices).to(torch.float64)
    corners = scene.camera.project(scene.pose(0).transform(vertices))
    (left, top), (right, bottom) = corners.amin(0).tolist(), corners.amax(0).tolist()
    visible = (left, top, right - left, bottom - top)
    truth = [Instance(7, scene.pose(0), 1.0, visible)]
    images = [BopImage(1, 0, scene.image(0), scene.camera, truth)]
    root = write_bop(tmp_path / "set", "test", {7: scene.mesh}, images)
    out = tmp_path / "results.csv"
    command = ["detect", "--dataset", str(root), "--split", "test", "--output", str(out)]
    assert main([*command, "--boxes", "truth"]) == 0
    (found,) = read_results(out)
    assert near(found.pose, scene.pose(0)) and found.score > 0.5
    one = {"scene_id": 1, "image_id": 0, "category_id": 7}
    boxes = [one | {"bbox": [5, 5, 20, 20], "score": 0.3}, one | {"bbox": visible, "score": 0.2}]
    boxes.append(one | {"bbox": [9, 9, 3, 30], "score": 0.9})
    (tmp_path / "boxes.json").write_text(json.dumps(boxes))
    capsys.readouterr()
    assert main([*command, "--boxes", str(tmp_path / "boxes.json")]) == 0
    assert "1 of 3 boxes are less than 4 pixels" in capsys.readouterr().err
    for other in read_results(out):  # of one instance, the best box: it is the wrong one
        assert not near(other.pose, scene.pose(0)) and other.score < 0.5
    boxes = [one | {"bbox": [5000, 5, 20, 20], "score": 0.9}]
    (tmp_path / "outside.json").write_text(json.dumps(boxes))
    out.unlink(missing_ok=True)
    assert main([*command, "--boxes", str(tmp_path / "outside.json")]) == 0
    assert "scene 1, image 0, object 7: box 5000 5 20 20" in capsys.readouterr().err
