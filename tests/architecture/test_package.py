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
from moveit6d.extras import EXTRAS

ROOT = Path(__file__).parents[2]
PUBLIC = {
    "Pose", "Camera", "Mesh", "PoseAction", "ActionSpace", "PoseEstimator", "PoseTracker",
    "PoseDetector", "TrackingResult", "TrackerConfig", "PAPER_CONFIG", "open_frames", "draw_pose",
    "VideoWriter", "OraclePolicy", "load_policy", "make_renderer", "InputError",
    "detect_objects", "LatestFrames", "__version__",
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


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wheel of this tree, built without the network."""
    if not {"pip", "setuptools"} <= {found.name for found in metadata.distributions()}:
        pytest.skip("needs pip and setuptools, which `make install` puts in place")
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"  # a copy, as building leaves things behind
    leave = shutil.ignore_patterns("__pycache__", "*.egg-info")
    for name in ("lib", "lightning_modules", "tests", "configs"):
        shutil.copytree(ROOT / name, source / name, ignore=leave)
    for name in ("pyproject.toml", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--no-build-isolation",
               "--no-index", "--quiet", "--wheel-dir", str(folder), str(source)]  # fmt: skip
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    (found,) = folder.glob("moveit6d-*.whl")
    return found


def test_wheel_alone_follows_an_object_without_any_extra(wheel: Path, tmp_path: Path) -> None:
    """Unpacked somewhere, with the packages of all extras out of reach."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    extras = [name for names in EXTRAS.values() for name in names]
    hidden = [*extras, "lightning", "torchmetrics", "OpenGL", "pytest", "hypothesis"]
    code = f"""
import sys
sys.modules.update(dict.fromkeys({hidden!r}))
sys.path.insert(0, {str(tmp_path / "site")!r})
import moveit6d
from moveit6d.cli.main import main
assert moveit6d.__file__.startswith({str(tmp_path)!r}), moveit6d.__file__
code = main(["demo", "--output", "demo", "--frames", "3", "--threads", "1"])
sentences = [main(words) for words in (
    ["fit", "--config", "none.yaml"], ["reproduce", "runtime", "--output", "out"],
    ["benchmark", "iteration", "--renderer", "pyrender"],
)]
print(code, sentences)
"""
    environment = {k: v for k, v in os.environ.items() if k != "PYTHONPATH"}
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=tmp_path, env=environment, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.splitlines()[-1] == "0 [2, 2, 3]", done.stdout + done.stderr
    assert (tmp_path / "demo" / "track" / "overlay.mp4").is_file()
    for extra in ("train", "report", "gl"):
        assert f"pip install 'moveit6d[{extra}]'" in done.stderr


def test_wheel_holds_the_two_packages_and_nothing_else(wheel: Path) -> None:
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
