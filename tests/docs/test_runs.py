"""The README's Python and the notebook run from top to bottom, on a clip made here."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest
import torch

from moveit6d.geometry.camera import Camera
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
