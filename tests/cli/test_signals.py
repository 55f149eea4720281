"""Signals end a run as Ctrl-C does: what was done is kept."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from moveit6d.datasets.pose_files import read_poses

Make = Callable[..., Any]


SLOW = """
import signal, sys, time
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # under nohup it would stay ignored
from moveit6d.cli.main import main
from moveit6d.estimation import PoseTracker
update = PoseTracker.update
def slowly(self, image):
    time.sleep(0.3)
    return update(self, image)
PoseTracker.update = slowly
sys.exit(main(sys.argv[1:]))
"""


@pytest.mark.parametrize("number", [signal.SIGTERM, signal.SIGHUP, signal.SIGKILL])
def test_signals_keep_what_was_done(make_sequence: Make, tmp_path: Path, number: int) -> None:
    made = make_sequence("clip", frames=5, still=True)
    made.poses[0].save(made.folder / "start.json")
    words = ["track", "--mesh", "mesh.ply", "--mesh_unit", "m", "--video", "frames",
             "--camera", "camera.json", "--start", "start.json", "--no_overlay",
             "--no_multi_start", "--no_contour", "--output", str(tmp_path / "out")]  # fmt: skip
    process = subprocess.Popen(
        [sys.executable, "-c", SLOW, *words], cwd=made.folder, stderr=subprocess.PIPE, text=True
    )
    table = tmp_path / "out" / "poses.csv"
    deadline = time.monotonic() + 120
    while process.poll() is None and time.monotonic() < deadline:
        if table.is_file() and len(read_poses(table)) >= 2:  # it can be read while it is written
            process.send_signal(number)
            break
        time.sleep(0.02)
    said = process.communicate(timeout=300)[1]
    assert 2 <= len(read_poses(table)) < 5
    if number == signal.SIGKILL:
        assert process.returncode == -signal.SIGKILL
        return
    assert process.returncode == 128 + number
    assert said.strip().endswith("what was finished is kept.") and "Traceback" not in said
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert summary["interrupted"] is True
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"poses.csv", "summary.json"}
