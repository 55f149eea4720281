"""Malformed inputs of every kind: each one sentence, none a traceback, a hang or a full memory."""

from __future__ import annotations

import resource
import shutil
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from moveit6d.datasets import open_dataset
from moveit6d.datasets.bop import BopDataset, read_results
from moveit6d.datasets.pose_files import read_camera, read_poses
from moveit6d.datasets.video import ImageFolder
from moveit6d.errors import InputError
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.networks.weights_file import load_network
from moveit6d.synthesis.training.shards import open_shards
from tests.support.malformed import Malformed, corpus, good_files

COUNT = 1500
SECONDS = 5  # that one input may take
MEGABYTES = 800  # that all of them together may need


def only(folder: Path, *suffixes: str) -> Path:
    return next(p for p in sorted(folder.iterdir()) if p.suffix.lower() in suffixes)


def read_mesh(folder: Path) -> None:
    Mesh.load(only(folder, ".obj", ".glb", ".gltf", ".ply", ".off", ".stl", ".dae"), "m")


def read_image(folder: Path) -> None:
    for frame in ImageFolder(folder):
        if frame.image is None:
            raise InputError(str(frame.error))


def read_dataset(kind: str) -> Callable[[Path], None]:
    def read(folder: Path) -> None:
        for sequence in open_dataset(folder, kind):
            sequence.load_mesh()
            for frame in sequence.open():
                if frame.image is None:
                    raise InputError(str(frame.error))

    return read


def read_bop(folder: Path) -> None:
    read_dataset("bop")(folder)
    dataset = BopDataset(folder, "test")
    for target in dataset.targets():
        dataset.truth(target.scene, target.image)
        dataset.camera(target.scene, target.image)
        if target.object is not None:
            dataset.diameter(target.object)


READERS: dict[str, Callable[[Path], Any]] = {
    "mesh": read_mesh,
    "camera": lambda folder: read_camera(folder / "camera.json"),
    "pose": lambda folder: Pose.load(folder / "pose.json"),
    "poses": lambda folder: read_poses(folder / "poses.csv"),
    "image": read_image,
    "results": lambda folder: read_results(folder / "r.csv"),
    "bop": read_bop,
    "weights": lambda folder: load_network(folder / "w.safetensors"),
    "pairs": open_shards,
    **{kind: read_dataset(kind) for kind in ("laval", "ycbv", "rbot", "folders")},
}


@contextmanager
def time_limit(seconds: int) -> Iterator[None]:
    def late(_: int, __: FrameType | None) -> None:
        raise TimeoutError

    before = signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)
        signal.signal(signal.SIGALRM, before)


def problem(case: Malformed, folder: Path) -> str:
    """What was wrong with how an input was taken; "" for a sentence, "read" if it can be read."""
    for name, content in case.files.items():
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
    try:
        with time_limit(SECONDS):
            READERS[case.reader](folder)
        return "read"
    except InputError as error:
        text = str(error)
        return "" if 10 < len(text) < 600 + 4 * len(str(folder)) else f"bad sentence: {text[:200]}"
    except TimeoutError:
        return "hangs"
    except BaseException as error:
        return f"{type(error).__name__}: {error}"[:200]


def test_the_inputs_are_good_before_they_are_damaged(tmp_path: Path) -> None:
    for number, (name, reader, files, _) in enumerate(good_files()):
        case = Malformed(name, reader, files)
        if reader != "weights":  # whose numbers are left out
            assert problem(case, tmp_path / str(number)) == "read", name


@pytest.mark.filterwarnings("ignore")
def test_malformed_inputs_are_a_sentence_each(tmp_path: Path) -> None:
    wrong, outcomes = [], Counter[str]()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begin = time.monotonic()
    for case in corpus(seed=24, count=COUNT):
        folder = tmp_path / "case"
        found = problem(case, folder)
        outcomes["read" if found == "read" else "wrong" if found else "sentence"] += 1
        if found not in ("", "read"):
            wrong.append(f"{case.name}: {found}")
        shutil.rmtree(folder)
        assert not list(tmp_path.rglob("*escaped*"))
    more = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    print(f"\n{dict(outcomes)}, {time.monotonic() - begin:.0f} s, {more:.0f} MB more")
    assert not wrong, "\n".join(wrong)
    # Much damage leaves a file that can be read (a flipped bit of a colour): that is no fault.
    assert outcomes["sentence"] > COUNT / 2
    assert more < MEGABYTES
