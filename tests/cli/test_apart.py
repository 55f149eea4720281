"""No verb writes over what it reads."""

from __future__ import annotations

import json
import shutil
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from moveit6d.cli.apart import check_apart, check_result, check_truth, given_paths
from moveit6d.cli.main import main
from moveit6d.errors import InputError
from tests.support.clip import Clip
from tests.support.patches import BOX, textured_glb

MATERIALS = "newmtl skin\nmap_Kd -clamp on skins/My Skin.png\n"


def test_what_is_given_and_not_written_is_read() -> None:
    args = Namespace(mesh=[Path("a"), Path("b")], camera=Path("c"), fov=None, output=Path("d"))
    assert [*given_paths(args, "output")] == [Path("a"), Path("b"), Path("c")]


@pytest.mark.parametrize(
    "name", ["out", "out/poses.csv", "mesh.ply", "out/../mesh.ply", "link.html", "log.rrd"]
)
def test_nothing_is_written_twice_or_over_an_input(tmp_path: Path, name: str) -> None:
    (tmp_path / "link.html").symlink_to(tmp_path / "mesh.ply")
    written = {
        "--output": [tmp_path / "out" / "poses.csv"],
        "--rerun": [tmp_path / "log.rrd"],
        "--report": [None, tmp_path / name],
    }
    with pytest.raises(InputError, match=f"^--report: .*{Path(name).name} would be replaced, "):
        check_apart(written, [tmp_path / "mesh.ply"])
    for good in ("out/report.html", "overlay.mp4", "poses.csv"):
        check_apart({**written, "--report": [tmp_path / good]}, [tmp_path / "mesh.ply"])


def test_a_folder_that_is_replaced_holds_no_input(tmp_path: Path) -> None:
    check_apart({"--output": [tmp_path / "clip"]}, [tmp_path / "clips" / "mesh.glb"])
    with pytest.raises(InputError, match="clip would be replaced, which this run reads; give"):
        check_apart({"--output": [tmp_path / "clip"]}, [tmp_path / "clip" / "mesh.glb"])


@pytest.mark.parametrize("name", ["skins/My Skin.png", "Drill.MTL", "drill.symmetry.json"])
def test_what_a_mesh_names_is_an_input(tmp_path: Path, name: str) -> None:
    mesh = tmp_path / "drill.obj"
    mesh.write_text("mtllib drill.mtl\nv 0 0 0\n")
    (tmp_path / "skins").mkdir()
    for one in ("Drill.MTL", "skins/My Skin.png", "drill.symmetry.json", "drill_sides.png"):
        (tmp_path / one).write_text(MATERIALS)
    with pytest.raises(InputError, match=r"would be replaced, which .*drill\.obj names; give"):
        check_apart({"--output": [tmp_path / name]}, [mesh])
    check_apart({"--output": [tmp_path / "drill_sides.png"]}, [mesh])


def test_a_picture_of_a_gltf_file_is_an_input(tmp_path: Path) -> None:
    mesh, skin = tmp_path / "can.gltf", tmp_path / "my skin.png"
    mesh.write_text(json.dumps({"images": [{"uri": "my%20skin.png"}]}))
    skin.write_text("picture")
    with pytest.raises(InputError, match="names; give another name"):
        check_apart({"--output": [skin]}, [mesh])


def test_a_file_of_a_data_set_is_an_input(tmp_path: Path) -> None:
    def check(output: Path) -> None:
        check_result(Namespace(dataset=tmp_path, split="test", output=output), tmp_path / "b.json")

    for name in ("test", "models"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "there.json").write_text("{}")
        with pytest.raises(InputError, match=r"there\.json would be replaced"):
            check(tmp_path / name / "there.json")
    with pytest.raises(InputError, match=r"b\.json would be replaced"):
        check(tmp_path / "b.json")
    check(tmp_path / "results.csv")
    (tmp_path / "results").mkdir()
    with pytest.raises(InputError, match="is a folder"):
        check(tmp_path / "results")


def test_true_poses_are_known_by_where_they_lie(clip: Clip) -> None:
    frames = sorted((clip.folder / "frames").iterdir())
    with pytest.raises(InputError, match=r"clip/poses\.csv would be replaced, which lies beside"):
        check_truth(clip.folder, frames)
    check_truth(clip.output, frames)
    (clip.folder / "summary.json").write_text('{"arguments": {}}')
    check_truth(clip.folder, frames)


@pytest.fixture
def cases(clip: Clip, tmp_path: Path) -> dict[str, list[str]]:
    """Commands that would destroy an input, on the clip and on files beside it."""
    tmp = str(tmp_path)
    (tmp_path / "drill.obj").write_text(BOX.obj("mtllib drill.mtl\nusemtl skin\n"))
    (tmp_path / "drill.mtl").write_text("newmtl skin\nmap_Kd drill.png\n")
    shutil.copy(clip.folder / "frames" / "000000.png", tmp_path / "drill.png")
    shutil.copytree(clip.folder / "frames", tmp_path / "photos")
    textured_glb().write(tmp_path / "mesh.glb")
    (tmp_path / "s.yaml").write_text("low_confidence: 0.4\n")
    (tmp_path / "a.csv").write_text("scene_id,im_id,obj_id,score,R,t,time\n")
    (tmp_path / "runtime.json").write_text('{"low_confidence": 0.4}')
    (tmp_path / "pairs.yaml").write_text("data:\n  shapes: 2\n")
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "tracks").symlink_to(tmp_path / "poses")
    (tmp_path / "photos" / "test").mkdir()
    (tmp_path / "photos" / "test" / "mask.png").write_text("mask")
    shutil.copytree(clip.folder, tmp_path / "poses")
    (tmp_path / "rivals" / "other").mkdir(parents=True)
    shutil.copy(clip.folder / "poses.csv", tmp_path / "rivals" / "other" / "clip.csv")
    (tmp_path / "found").mkdir()
    shutil.copy(clip.folder / "start.json", tmp_path / "found" / "pose.json")
    folder = str(clip.folder)
    image = f"{folder}/frames/000000.png"
    doctor = ["doctor", "--mesh", f"{tmp}/drill.obj", "--mesh_unit", "m", "--output"]
    known = [
        "--mesh",
        f"{folder}/mesh.ply",
        "--mesh_unit",
        "m",
        "--camera",
        f"{folder}/camera.json",
    ]
    track = ["track", *known, "--video", f"{folder}/frames", "--start", f"{folder}/start.json"]
    detect = ["detect", *known, "--image", image]
    start = ["--start", f"{tmp}/found/pose.json", "--output", f"{tmp}/found"]
    data = ["--dataset", f"{tmp}/photos", "--split", "test"]
    score = ["evaluate", "tracking", "--sequences", folder, "--results", f"{folder}/poses.csv"]
    bench = ["benchmark", "tracking", "--sequences"]
    lose = ["benchmark", "recovery", "--sequences", f"{tmp}/poses", "--photos", f"{tmp}/photos"]
    sheet = ["contact-sheet", "--set", f"data.photos={tmp}/photos", "--set", "data.meshes=null"]
    return {
        "texture": [*doctor, f"{tmp}/drill.png"],
        "material": [*doctor, f"{tmp}/drill.mtl"],
        "mesh": [*doctor, f"{tmp}/drill.obj"],
        "start": [*detect, *start],
        "start of several": [*detect, image, *start],
        "truth beside the images": [*detect, "--output", folder],
        "truth": [*track, "--output", folder],
        "settings": [*track, "--config", f"{tmp}/s.yaml", "--report", f"{tmp}/s.yaml",
                     "--output", f"{tmp}/out"],
        "initial": ["refine", *data, "--initial", f"{tmp}/a.csv", "--output", f"{tmp}/a.csv"],
        "targets": ["detect", *data, "--targets", f"{tmp}/a.csv", "--output", f"{tmp}/a.csv"],
        "photo": ["calibrate", "--video", f"{tmp}/photos", "--output", f"{tmp}/photos/000001.png"],
        "board": ["calibrate", "--video", f"{tmp}/photos", "--output", f"{tmp}/camera.json",
                  "--print_board", f"{tmp}/photos/000001.png"],
        "mesh of a clip": ["synthesize", "--mesh", f"{tmp}/mesh.glb", "--output", tmp],
        "frames": ["detect", *known, "--image", image, "--output", f"{folder}/frames"],
        "frame by a diagram": [*score, "--reliability", f"{folder}/frames/000000"],
        "mask by a diagram": ["evaluate", "bop", *data, "--results", f"{tmp}/a.csv",
                              "--reliability", f"{tmp}/photos/test/mask"],
        "rival": [*bench, folder, "--rivals", f"{tmp}/rivals", "--output", f"{tmp}/rivals/other"],
        "truth by a benchmark": [*bench, f"{tmp}/poses", "--output", f"{tmp}/poses"],
        "truth by recovery": [*lose, "--output", f"{tmp}/poses"],
        "settings of a reproduction": ["reproduce", "runtime", "--config", f"{tmp}/runtime.json",
                                       "--output", tmp],
        "truth by a reproduction": ["reproduce", "ycb_add", "--data", f"{tmp}/poses",
                                    "--output", f"{tmp}/run"],
        "photo of pairs": [*sheet, "--output", f"{tmp}/photos/000001.png"],
        "configuration of pairs": [*sheet, "--config", f"{tmp}/pairs.yaml",
                                   "--output", f"{tmp}/pairs.yaml"],
    }  # fmt: skip


NAMES = [
    "texture", "material", "mesh", "start", "start of several", "truth beside the images", "truth",
    "settings", "initial", "targets", "photo", "board", "mesh of a clip", "frames",
    "frame by a diagram", "mask by a diagram", "rival", "truth by a benchmark", "truth by recovery",
    "settings of a reproduction", "truth by a reproduction", "photo of pairs",
    "configuration of pairs",
]  # fmt: skip


@pytest.mark.parametrize("name", NAMES)
def test_no_input_is_destroyed(
    cases: dict[str, list[str]], tmp_path: Path, capsys: Any, name: str,
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    if name in ("initial", "targets"):  # said before anything of a data set is read
        monkeypatch.setattr("moveit6d.datasets.bop.BopDataset", dataset_with_targets)

    def files() -> dict[Path, bytes]:
        return {path: path.read_bytes() for path in tmp_path.rglob("*") if path.is_file()}

    before = files()
    assert main(cases[name]) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert "would be" in said and "; give another" in said
    assert files() == before


def dataset_with_targets(*_: Any, **__: Any) -> Any:
    return Namespace(targets=lambda _: [])


def test_every_case_is_tried(cases: dict[str, list[str]]) -> None:
    assert [*cases] == NAMES


def test_a_track_goes_on_with_its_own_table(
    clip: Clip, interrupt_update: Callable[[int], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    (clip.folder / "poses.csv").unlink()
    output = {"output": str(clip.folder)}
    with monkeypatch.context():
        interrupt_update(3)
        assert clip.track("--no_overlay", **output) == 130
    monkeypatch.undo()
    assert clip.track("--no_overlay", "--resume", **output) == 0
    assert clip.track("--no_overlay", **output) == 0, "its own results are replaced as ever"
