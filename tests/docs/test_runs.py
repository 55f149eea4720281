"""The README's Python and the notebook run from top to bottom, on a clip made here."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.datasets.pose_files import PoseRow, write_poses
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.pose import Pose
from moveit6d.synthesis.objects.demo_object import demo_object
from moveit6d.synthesis.sequences.sequence import write_sequence
from moveit6d.visualization.video import VideoWriter
from tests.docs.test_pages import ROOT, blocks

SMALL = Camera(308.0, 308.0, 159.5, 119.5, 320, 240)


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the files that the README names."""
    from moveit6d.datasets.video import open_frames

    clip = write_sequence(
        tmp_path / "clip", mesh=demo_object(), seed=1, frames=3, difficulty="easy", camera=SMALL
    )
    with VideoWriter(tmp_path / "clip.mp4") as video:
        for frame in open_frames(clip / "frames"):
            assert frame.image is not None
            video.write(frame.image)
    for name, wanted in (("mesh.glb", "drill.glb"), ("start.json", "pose.json")):
        (clip / name).rename(tmp_path / wanted)
    (clip / "camera.json").rename(tmp_path / "camera.json")
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_readme_follows_a_clip(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (code,) = blocks(ROOT / "README.md", "python")
    namespace: dict[str, Any] = {}
    exec(compile(code, "README.md", "exec"), namespace)
    assert re.findall(r"^(\d+) ", capsys.readouterr().out, re.MULTILINE) == ["0", "1", "2"]
    assert namespace["result"].confidence > 0.5


def test_the_page_on_using_poses_runs(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pose = Pose.load("pose.json")
    rows = [PoseRow(0, "000000.jpg", pose, state="tracking"), PoseRow(1, "000001.jpg")]
    write_poses("out/poses.csv", rows)
    np.savetxt("cam_K.txt", SMALL.matrix.numpy())
    megapose = {"K": SMALL.matrix.tolist(), "resolution": [SMALL.height, SMALL.width]}
    Path("camera_data.json").write_text(json.dumps(megapose))
    found: dict[str, Any] = {}
    first, *later = blocks(ROOT / "docs" / "how-to" / "use-poses.md", "python")
    exec(compile(first, "use-poses.md", "exec"), found)
    assert capsys.readouterr().out.startswith("0 000000.jpg tensor(")
    for code in later:
        exec(compile(code, "use-poses.md", "exec"), found)
    again = Pose.from_quaternion([found[name] for name in "xyzw"], pose.translation, "xyzw")
    torch.testing.assert_close(again.matrix, pose.matrix, rtol=0, atol=1e-6)
    torch.testing.assert_close(
        Pose.from_rvec(found["rvec"], pose.translation).matrix, pose.matrix, rtol=0, atol=1e-6
    )
    assert (found["model_view"] @ [0, 0, 0, 1])[2] < 0, "in front of OpenGL's camera"
    moved = found["object_in_world"].translation - pose.translation
    torch.testing.assert_close(moved.tolist(), [0.2, 0.0, 1.5], rtol=0, atol=1e-9)
    assert (found["pixel"] > 0).all() and (found["pixel"] < 320).all()
    # 640 × 480 is the page's size, not this clip's.
    assert found["camera"].matrix.tolist() == SMALL.matrix.tolist()
    assert Camera.load("camera.json").width == 640 and Camera.load("megapose.json") == SMALL


def test_the_notebook_runs(capsys: pytest.CaptureFixture[str]) -> None:
    threads = torch.get_num_threads()
    notebook = json.loads((ROOT / "examples" / "first_steps.ipynb").read_text(encoding="utf-8"))
    namespace: dict[str, Any] = {}
    try:
        for number, cell in enumerate(notebook["cells"]):
            if cell["cell_type"] == "code":
                assert not cell["outputs"], "committed without outputs"
                source = "".join(cell["source"])
                exec(compile(source, f"first_steps.ipynb, cell {number}", "exec"), namespace)
    finally:
        torch.set_num_threads(threads)
    assert "mean ADD" in capsys.readouterr().out
    assert namespace["shown"].shape == (480, 640, 3)
