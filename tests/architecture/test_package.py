"""The front door: public names, what importing does, and what the wheel holds."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from importlib import metadata
from pathlib import Path

import pytest

import moveit6d

ROOT = Path(__file__).parents[2]
PUBLIC = {
    "Pose", "Camera", "Mesh", "PoseAction", "ActionSpace", "PoseEstimator", "PoseTracker",
    "PoseDetector", "TrackingResult", "OraclePolicy", "load_policy", "make_renderer", "InputError",
    "__version__",
}  # fmt: skip
HEAVY = ("pytorch_lightning", "lightning", "pyrender", "OpenGL", "matplotlib", "cv2", "av")

# Imports the library and reports what was loaded and touched. Python's own machinery reads
# modules; anything else that is opened, and any look at the environment, is reported.
PROBE = """
import json, os, sys, importlib.machinery
modules = tuple(importlib.machinery.all_suffixes())
touched = []
def watch(event, arguments):
    if event == "open" and not str(arguments[0]).endswith(modules):
        touched.append(str(arguments[0]))
    if event in ("os.putenv", "socket.connect", "subprocess.Popen"):
        touched.append(event)
class Watched(type(os.environ)):
    def __getitem__(self, key):
        touched.append("environment " + str(key))
        return super().__getitem__(key)
os.environ.__class__ = Watched
sys.addaudithook(watch)
import moveit6d
os.environ.__class__ = Watched.__mro__[1]
json.dump({"touched": touched, "modules": sorted(sys.modules)}, sys.stdout)
"""


def run_python(code: str, folder: Path) -> str:
    """What a fresh interpreter prints, started elsewhere, without a display."""
    paths = [str(ROOT / "lib"), str(ROOT)]
    environment = {k: v for k, v in os.environ.items() if k not in ("DISPLAY", "PYTHONPATH")}
    environment["PYTHONPATH"] = os.pathsep.join(paths)
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_public_names_are_these() -> None:
    assert set(moveit6d.__all__) == PUBLIC
    assert set(moveit6d.__all__) <= set(dir(moveit6d))


@pytest.mark.parametrize("name", sorted(PUBLIC))
def test_public_name_is_there(name: str) -> None:
    assert getattr(moveit6d, name) is not None


def test_other_names_are_refused_as_usual() -> None:
    with pytest.raises(AttributeError, match="no attribute 'Nothing'"):
        _ = moveit6d.Nothing  # type: ignore[attr-defined]


def test_import_loads_nothing_heavy_and_touches_nothing(tmp_path: Path) -> None:
    found = json.loads(run_python(PROBE, tmp_path))
    loaded = {name.split(".")[0] for name in found["modules"]}
    assert not loaded & {*HEAVY, "torch", "kornia", "numpy"}
    assert found["touched"] == []


def test_using_the_nouns_loads_nothing_heavy(tmp_path: Path) -> None:
    code = f"""
import sys, moveit6d
for name in moveit6d.__all__:
    getattr(moveit6d, name)
print([name for name in {HEAVY!r} if name in sys.modules])
"""
    assert run_python(code, tmp_path).strip() == "[]"


def test_version_stands_in_one_place() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())
    assert project["project"]["dynamic"] == ["version"]
    assert f"## [{moveit6d.__version__}]" in (ROOT / "CHANGELOG.md").read_text()


def test_constraints_pin_every_dependency() -> None:
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = {line.split("==")[0].lower().replace("_", "-") for line in lines if "==" in line}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    extras = project["optional-dependencies"]
    wanted = [*project["dependencies"], *(one for extra in extras.values() for one in extra)]
    for requirement in wanted:
        name = requirement.split("[")[0].split(">")[0].strip().lower()
        if name == project["name"]:  # an extra made of others
            continue
        assert name in pins, f"{name} has no pinned version"
    assert "torch==2.13.0" in lines


def test_wheel_holds_the_two_packages_and_nothing_else(tmp_path: Path) -> None:
    if not {"pip", "setuptools"} <= {found.name for found in metadata.distributions()}:
        pytest.skip("needs pip and setuptools, which `make install` puts in place")
    source = tmp_path / "source"  # a copy, as building leaves things behind
    leave = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in ("lib", "lightning_modules", "tests", "configs"):
        shutil.copytree(ROOT / name, source / name, ignore=leave)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    command = [
        sys.executable,
        "-m",
        "pip",
        "wheel",
        "--no-deps",
        "--no-build-isolation",
        "--no-index",
        "--quiet",
        "--wheel-dir",
        str(tmp_path),
        str(source),
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("moveit6d-*.whl")
    names = zipfile.ZipFile(wheel).namelist()
    info = f"moveit6d-{moveit6d.__version__}.dist-info"
    data = f"moveit6d-{moveit6d.__version__}.data"
    roots = {name.split("/")[0] for name in names}
    assert roots == {"moveit6d", "lightning_modules", info, data}
    configs = {path.relative_to(ROOT).as_posix() for path in (ROOT / "configs").rglob("*.yaml")}
    place = f"{data}/data/share/moveit6d/"
    assert {name.removeprefix(place) for name in names if name.startswith(data)} == configs
    files = {name for name in names if not name.startswith((info, data))}
    kinds = {Path(name).suffix or Path(name).name for name in files}
    assert kinds <= {".py", ".typed", ".safetensors", ".md", ".j2"}
    assert "moveit6d/visualization/templates/report.html.j2" in files
    assert {"moveit6d/py.typed", "lightning_modules/__init__.py"} <= files
    committed = {path.name for path in (ROOT / "lib/moveit6d/weights").iterdir()}
    shipped = {Path(name).name for name in files if name.startswith("moveit6d/weights/")}
    assert shipped == {name for name in committed if name.endswith((".safetensors", ".md"))}
    modules = {
        str(path.relative_to(ROOT / "lib")) for path in (ROOT / "lib/moveit6d").rglob("*.py")
    }
    assert modules <= files
