"""Scripts that train: what an earlier lease has written stays, and how each is called."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[2] / "tools"

pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")


def test_a_resumed_training_goes_on_in_the_log(tmp_path: Path) -> None:
    python = tmp_path / "python3"
    python.write_text("#!/bin/sh\ncat >/dev/null\necho trained\n")
    python.chmod(0o755)
    script = Path(shutil.copy(TOOLS / "train_on_gpu.sh", tmp_path))
    (tmp_path / "mesh_unit").write_text("m", encoding="utf-8")
    path = f"{tmp_path}:{os.environ['PATH']}"
    for _ in range(2):
        subprocess.run(
            ["bash", str(script), "1"],
            env={"PATH": path, "OUT": str(tmp_path / "out")},
            stdin=subprocess.DEVNULL,
            capture_output=True,
            check=True,
        )
    assert (tmp_path / "out" / "log.txt").read_text() == "trained\n" * 2


@pytest.mark.parametrize("name", ["train_on_gpu", "train_shipped", "ablation", "object_specific"])
def test_without_arguments_a_script_says_how_it_is_called(tmp_path: Path, name: str) -> None:
    script = shutil.copy(TOOLS / f"{name}.sh", tmp_path)
    done = subprocess.run(["bash", script], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2 and not done.stderr
    assert f"{name}.sh " in done.stdout and "set -e" not in done.stdout
    assert [path.name for path in tmp_path.iterdir()] == [f"{name}.sh"], "nothing is made"


@pytest.mark.parametrize("content", [b"", b"PK" + bytes(90)], ids=["empty", "cut off"])
def test_a_damaged_checkpoint_of_an_earlier_lease_is_one_sentence(
    tmp_path: Path, content: bytes
) -> None:
    script = shutil.copy(TOOLS / "train_on_gpu.sh", tmp_path)
    (tmp_path / "mesh_unit").write_text("m", encoding="utf-8")
    python = tmp_path / "python3"
    python.write_text(f'#!/bin/sh\nexec {sys.executable} "$@"\n', encoding="utf-8")
    python.chmod(0o755)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "last.ckpt").write_bytes(content)
    done = subprocess.run(
        ["bash", script, "1"],
        env={"PATH": f"{tmp_path}:{os.environ['PATH']}"},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1
    assert "last.ckpt is damaged: remove it" in done.stderr
