"""The training on a lent GPU: what an earlier lease has written stays."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "tools" / "train_on_gpu.sh"


@pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")
def test_a_resumed_training_goes_on_in_the_log(tmp_path: Path) -> None:
    python = tmp_path / "python3"
    python.write_text("#!/bin/sh\ncat >/dev/null\necho trained\n")
    python.chmod(0o755)
    path = f"{tmp_path}:{os.environ['PATH']}"
    for _ in range(2):
        subprocess.run(
            ["bash", str(SCRIPT), "1"],
            env={"PATH": path, "OUT": str(tmp_path / "out")},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=True,
        )
    assert (tmp_path / "out" / "log.txt").read_text() == "trained\n" * 2
