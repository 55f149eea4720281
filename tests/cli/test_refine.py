"""`moveit6d refine`: BOP in, BOP out, in the same order; bad rows are named by their number."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from PIL import Image

from moveit6d.cli import refine
from moveit6d.cli.main import main
from moveit6d.config import LoopConfig
from moveit6d.datasets.bop import BopDataset, Estimate, read_results, write_results
from moveit6d.estimation import estimator
from moveit6d.estimation.localizability import localizability
from moveit6d.evaluation.metrics import add
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from tests.support.settings_read import offered, recorded


@pytest.fixture
def dataset(tmp_path: Path, scene: Any, brick_file: Path) -> BopDataset:
    """The brick, in millimetres, in three images that all show it at the same pose."""
    import trimesh

    root = tmp_path / "bricks"
    scene_folder = root / "val" / "000004"
    (scene_folder / "rgb").mkdir(parents=True)
    (root / "models").mkdir()
    mesh = trimesh.load(brick_file, process=False)
    mesh.apply_scale(1000.0)
    mesh.export(root / "models" / "obj_000002.ply")
    (root / "models" / "models_info.json").write_text(json.dumps({"2": {"diameter": 152.6}}))
    k = scene.camera.matrix.reshape(-1).tolist()
    (scene_folder / "scene_camera.json").write_text(
        json.dumps({str(n): {"cam_K": k} for n in (1, 2, 3)})
    )
    true = scene.pose(0)
    gt = {
        "obj_id": 2,
        "cam_R_m2c": true.rotation.reshape(-1).tolist(),
        "cam_t_m2c": (1000 * true.translation).tolist(),
    }
    (scene_folder / "scene_gt.json").write_text(json.dumps({str(n): [gt] for n in (1, 2, 3)}))
    for n in (1, 2, 3):
        Image.fromarray(scene.image(0)).save(scene_folder / "rgb" / f"{n:06d}.png")
    return BopDataset(root, "val")


def off(true: Pose, by: float) -> Pose:
    return Pose(true.rotation, true.translation + torch.tensor([by, -by, 3 * by]).double())


@pytest.fixture
def command(dataset: BopDataset, scene: Any, tmp_path: Path) -> Callable[..., int]:
    """Writes initial poses and refines them."""

    def run(rows: list[Estimate], *more: str) -> int:
        write_results(tmp_path / "initial.csv", rows)
        return main(
            [
                "refine",
                "--dataset",
                str(dataset.root),
                "--split",
                "val",
                "--initial",
                str(tmp_path / "initial.csv"),
                "--output",
                str(tmp_path / "refined.csv"),
                *more,
            ]
        )

    return run


@pytest.fixture
def rows(scene: Any) -> list[Estimate]:
    """Five rows, images mixed."""
    true = scene.pose(0)
    return [
        Estimate(4, image, 2, 0.1 * n, off(true, 0.001 * (n + 1)))
        for n, image in enumerate((2, 1, 2, 3, 1))
    ]


@pytest.mark.parametrize("batch", ["1", "2", "32"])
def test_poses_get_better_and_keep_their_order(
    dataset: BopDataset,
    command: Callable[..., int],
    rows: list[Estimate],
    use_oracle: Callable[..., None],
    scene: Any,
    tmp_path: Path,
    capsys: Any,
    batch: str,
) -> None:
    use_oracle(dataset.mesh(2), scene.pose(0), targets=2)
    assert command(rows, "--batch", batch, "--threads", "1") == 0
    refined = read_results(tmp_path / "refined.csv")
    points = torch.from_numpy(scene.mesh.sample_points(100))
    for before, after in zip(rows, refined, strict=True):
        assert (before.scene, before.image, before.object) == (
            after.scene,
            after.image,
            after.object,
        )
        assert float(add(after.pose, scene.pose(0), points)) < 0.003
        # The oracle is confident.
        likely = localizability(
            scene.mesh.inner(scene.pose(0)), scene.mesh, scene.camera, LoopConfig().width_error
        )
        assert after.score == pytest.approx(likely, abs=0.01) and 0.5 < likely < 0.9
    seconds = [row.seconds for row in refined]
    assert seconds[0] == seconds[2] > 0 and seconds[1] == seconds[4], "one time an image"
    assert "5 poses in 3 images, 0 kept as given" in capsys.readouterr().out


def test_an_interrupted_run_is_gone_on_with(
    dataset: BopDataset,
    command: Callable[..., int],
    rows: list[Estimate],
    use_oracle: Callable[..., None],
    scene: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    use_oracle(dataset.mesh(2), scene.pose(0), targets=2)
    assert command(rows) == 0
    whole = read_results(tmp_path / "refined.csv")
    assert not list(tmp_path.glob("*.unfinished"))
    calls, refine_image = [], refine.refine_image

    def stopped(*given: Any) -> list[Estimate]:
        calls.append(given)
        if len(calls) == 2:
            raise KeyboardInterrupt
        return refine_image(*given)

    with monkeypatch.context() as patch:
        patch.setattr(refine, "refine_image", stopped)
        assert command(rows) == 130
    assert len(read_results(tmp_path / "refined.csv")) == 2, "what was done until then"
    with (tmp_path / "refined.csv.unfinished").open("a") as file:
        file.write('{"row": 4, "rota')  # as kill -9 may leave it
    assert command(rows, "--resume", "--no_contour") == 2, "begun with other settings"
    calls.clear()
    with monkeypatch.context() as patch:
        patch.setattr(refine, "refine_image", lambda *g: calls.append(g) or refine_image(*g))
        assert command(rows, "--resume") == 0
    assert len(calls) == 2, "one image was done before"
    assert not list(tmp_path.glob("*.unfinished"))
    for one, other in zip(read_results(tmp_path / "refined.csv"), whole, strict=True):
        torch.testing.assert_close(one.pose.matrix, other.pose.matrix)


def test_a_place_that_cannot_be_written_is_said_before_the_work(
    command: Callable[..., int], rows: list[Estimate], tmp_path: Path, capsys: Any
) -> None:
    (tmp_path / "refined.csv").mkdir()
    assert command(rows) == 2
    assert "refined.csv is a folder" in capsys.readouterr().err


def test_before_and_after_are_compared_by_evaluate(
    dataset: BopDataset,
    command: Callable[..., int],
    use_oracle: Callable[..., None],
    scene: Any,
    tmp_path: Path,
    capsys: Any,
) -> None:
    rows = [Estimate(4, n, 2, 0.5, off(scene.pose(0), 0.005 * n)) for n in (1, 2, 3)]
    use_oracle(dataset.mesh(2), scene.pose(0), targets=1)
    assert command(rows) == 0
    capsys.readouterr()
    files = [str(tmp_path / name) for name in ("initial.csv", "refined.csv")]
    assert (
        main(
            [
                "evaluate",
                "bop",
                "--dataset",
                str(dataset.root),
                "--split",
                "val",
                "--results",
                *files,
            ]
        )
        == 0
    )
    cells = [
        [cell.strip() for cell in line.split("|")[1:-1]]
        for line in capsys.readouterr().out.splitlines()
    ]
    # 5 mm sideways twice and 15 mm in depth are 16.6 mm, 10.9 % of 152.6 mm: all wrong before.
    assert cells[2][:3] == [files[0], "3", "0.0 %"]
    assert cells[3][:3] == [files[1], "3", "100.0 %"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"object": 9}, "row 2: .*does not know object 9; it knows 2"),
        ({"image": 7}, r"row 2: image 7 of scene 4: there is no .*000007\.png"),
        ({"scene": 5}, "row 2: scene 5: no folder .*scenes there: 4"),
    ],
)
def test_a_row_that_fits_nothing_is_named(
    command: Callable[..., int],
    rows: list[Estimate],
    tmp_path: Path,
    capsys: Any,
    change: dict[str, int],
    words: str,
) -> None:
    import re

    rows[1] = replace(rows[1], **change)
    assert command(rows) == 2
    said = capsys.readouterr().err
    assert re.search(words, said) and len(said.splitlines()) == 1
    assert not (tmp_path / "refined.csv").exists()


def test_a_damaged_image_and_a_pose_out_of_sight_keep_what_was_given(
    dataset: BopDataset,
    command: Callable[..., int],
    rows: list[Estimate],
    use_oracle: Callable[..., None],
    scene: Any,
    tmp_path: Path,
    capsys: Any,
) -> None:
    use_oracle(dataset.mesh(2), scene.pose(0), targets=2)
    (dataset.root / "val" / "000004" / "rgb" / "000003.png").write_bytes(b"\x89PNG")
    rows[0] = replace(rows[0], pose=off(scene.pose(0), -0.4))  # behind the camera
    assert command(rows) == 0
    refined = read_results(tmp_path / "refined.csv")
    for n in (0, 3):
        assert refined[n].score == 0.0
        np.testing.assert_allclose(refined[n].pose.translation, rows[n].pose.translation, atol=1e-9)
    # The oracle is confident.
    likely = localizability(
        scene.mesh.inner(scene.pose(0)), scene.mesh, scene.camera, LoopConfig().width_error
    )
    assert [refined[n].score for n in (1, 2, 4)] == pytest.approx([likely] * 3, abs=0.01)
    said = capsys.readouterr()
    assert "behind the camera" in said.err and "not a readable image" in said.err
    assert "2 kept as given" in said.out


def test_an_object_whose_pose_is_of_no_use_is_looked_for(
    command: Callable[..., int],
    rows: list[Estimate],
    scene: Any,
    tmp_path: Path,
    capsys: Any,
) -> None:
    lost = replace(rows[3], pose=off(scene.pose(0), -0.4))  # behind the camera
    assert command([lost]) == 0
    (found,) = read_results(tmp_path / "refined.csv")
    points = torch.from_numpy(scene.mesh.sample_points(100))
    assert float(add(found.pose, scene.pose(0), points)) < 0.1 * scene.mesh.diameter
    assert 0.3 < found.score < 1
    said = capsys.readouterr()
    assert "behind the camera" in said.err and "looked for in the whole image" in said.err
    assert "0 kept as given" in said.out
    assert command([lost], "--no_recovery") == 0
    (kept,) = read_results(tmp_path / "refined.csv")
    assert kept.score == 0.0 and "1 kept as given" in capsys.readouterr().out
    np.testing.assert_allclose(kept.pose.translation, lost.pose.translation, atol=1e-9)


def test_ctrl_c_keeps_the_images_done(
    dataset: BopDataset,
    command: Callable[..., int],
    rows: list[Estimate],
    use_oracle: Callable[..., None],
    scene: Any,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    use_oracle(dataset.mesh(2), scene.pose(0), targets=2)
    refine, calls = estimator.refine_single, iter(range(9))

    def stop_at_third(*args: Any, **options: Any) -> Any:
        if next(calls) == 2:
            raise KeyboardInterrupt
        return refine(*args, **options)

    monkeypatch.setattr("moveit6d.estimation.refine_single", stop_at_third)
    assert command(rows) == 130
    assert [row.image for row in read_results(tmp_path / "refined.csv")] == [2, 1, 2, 1]


def test_its_options_are_the_settings_that_it_reads(
    command: Callable[..., int], rows: list[Estimate], scene: Any
) -> None:
    lost = replace(rows[3], pose=off(scene.pose(0), -0.4))  # behind the camera
    # All are looked at, by templates that are not known from another test.
    search = ["--detection.accepted", "1", "--detection.match.more_places", "1",
              "--detection.templates.rotations", "301"]  # fmt: skip
    with recorded() as read:
        assert command([rows[0]], "--multi_start.below", "1") == 0
        assert command([rows[0]], "--mode", "single", "--max_iterations", "2") == 0
        assert command([lost], *search) == 0
    region = {(name, field) for name, field in read if name == "RegionConfig"}  # without any
    assert read - region - {("LoopConfig", "displacement_error")} == offered("refine")


@pytest.mark.parametrize("option", ["--no_calibration", "--low_confidence", "--max_milliseconds"])
def test_options_that_change_nothing_do_not_exist(option: str, capsys: Any) -> None:
    with pytest.raises(SystemExit) as ended:
        main(
            ["refine", "--dataset", "d", "--split", "s", "--initial", "i", "--output", "o", option]
        )
    assert ended.value.code == 2 and f"there is no option {option}" in capsys.readouterr().err


def test_an_unknown_split_is_said(
    dataset: BopDataset, tmp_path: Path, capsys: Any, brick: Mesh
) -> None:
    assert (
        main(
            [
                "refine",
                "--dataset",
                str(dataset.root),
                "--split",
                "test",
                "--initial",
                "a.csv",
                "--output",
                "b.csv",
            ]
        )
        == 2
    )
    assert "no split 'test'; folders there: val" in capsys.readouterr().err


def test_workers_refine_the_same(
    command: Callable[..., int],
    rows: list[Estimate],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Everything a worker needs is in what it is sent; that workers work is tests/test_parallel."""
    import pickle

    from moveit6d import parallel
    from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
    from moveit6d.networks.weights_file import save_network

    tiny = CorrelationConfig(channels=(4, 6, 8), geometry=(4, 4, 4), context=8, decoder=8, fine=8)
    torch.manual_seed(0)
    save_network(CorrelationNet(tiny), tmp_path / "weights.safetensors")
    options = ["--weights", str(tmp_path / "weights.safetensors"), "--max_iterations", "2"]
    assert command(rows, *options) == 0
    alone = read_results(tmp_path / "refined.csv")
    sent = []

    def beside(work: Any, items: Any, count: int) -> Any:
        for index in reversed(range(len(items))):  # workers end in any order
            sent.append(count)
            far_work, item = pickle.loads(pickle.dumps((work, items[index])))
            yield parallel.JobResult(index, far_work(item))

    monkeypatch.setattr(parallel, "_beside", beside)
    assert command(rows, *options, "--jobs", "2") == 0
    assert sent == [2, 2, 2]
    for one, two in zip(alone, read_results(tmp_path / "refined.csv"), strict=True):
        assert (one.image, one.score) == (two.image, two.score)
        assert torch.equal(one.pose.rotation, two.pose.rotation)
        assert torch.equal(one.pose.translation, two.pose.translation)
