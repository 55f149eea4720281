"""The scripts that set a machine up say what to do where they cannot."""

from __future__ import annotations

import os
import shutil
import subprocess
from pathlib import Path

import pytest

TOOLS = Path(__file__).parents[2] / "tools"
pytestmark = pytest.mark.skipif(shutil.which("bash") is None, reason="needs bash")


def run(
    script: str, *arguments: str, programs: tuple[str, ...], folder: Path, **extra: str
) -> subprocess.CompletedProcess[str]:
    """Run a script that finds no programs but these."""
    found = folder / "bin"
    found.mkdir()
    for name in (
        "bash",
        "env",
        "dirname",
        "mkdir",
        "mktemp",
        "rm",
        "cp",
        "find",
        "head",
        *programs,
    ):
        place = shutil.which(name)
        assert place is not None
        (found / name).symlink_to(place)
    environment = {"PATH": str(found), "TMPDIR": str(folder), **extra}
    command = ["bash", str(TOOLS / script), *arguments]
    return subprocess.run(command, env=environment, capture_output=True, text=True, cwd=folder)


def test_no_apt_is_said(tmp_path: Path) -> None:
    done = run("unpack_debian_package.sh", "some-package", "here", programs=(), folder=tmp_path)
    assert done.returncode == 1
    assert "apt-get is not on this machine" in done.stderr
    assert "dpkg -x some-package" in done.stderr


def test_python_without_venv_is_said(tmp_path: Path) -> None:
    python = tmp_path / "python"
    python.write_text("#!/bin/bash\nexit 1\n")
    python.chmod(0o755)
    done = run("make_venv.sh", "env", programs=(), folder=tmp_path, PYTHON=str(python))
    assert done.returncode == 1
    assert "apt install python3-venv" in done.stderr
    assert not (tmp_path / "env").exists()


def test_an_environment_that_is_there_is_kept(tmp_path: Path) -> None:
    place = tmp_path / "env" / "bin"
    place.mkdir(parents=True)
    (place / "python").write_text("#!/bin/bash\nexit 0\n")
    (place / "python").chmod(0o755)
    done = run("make_venv.sh", "env", programs=(), folder=tmp_path, PYTHON="/nowhere/python")
    assert done.returncode == 0 and done.stderr == ""


@pytest.mark.parametrize("path", [*sorted(TOOLS.glob("*.sh")), TOOLS.parent / ".ci" / "run"])
def test_scripts_can_be_run(path: Path) -> None:
    assert os.access(path, os.X_OK)
    assert subprocess.run(["bash", "-n", str(path)]).returncode == 0
