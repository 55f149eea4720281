"""What commands are tried on: clips on disk, and a policy that knows the truth."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from pathlib import Path
from typing import Any

import pytest
import torch
from PIL import Image

from moveit6d.estimation import PoseTracker
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from tests.support.clip import Clip
from tests.support.pairs import photos

Make = Callable[..., Any]


@pytest.fixture
def use_oracle(monkeypatch: pytest.MonkeyPatch) -> Callable[..., None]:
    """Lets every command decide by the true pose (mesh file's frame) of a still object."""

    def use(mesh: Mesh, pose: Pose, targets: int = 1) -> None:
        oracle = OraclePolicy(Pose.stack([mesh.inner(pose)] * targets))

        def load(*_: Any, **__: Any) -> Any:
            return oracle

        monkeypatch.setattr("moveit6d.policies.load_policy", load)

    return use


@pytest.fixture
def use_search(monkeypatch: pytest.MonkeyPatch) -> Callable[[Pose | None], list[dict[str, Any]]]:
    """Lets searches of a first frame find a pose, or nothing; what is known there is listed."""

    def use(pose: Pose | None) -> list[dict[str, Any]]:
        asked: list[dict[str, Any]] = []

        def found(detector: Any, first: Any, known: dict[str, Any], *_: Any) -> Pose | None:
            asked.append(known)
            return pose

        monkeypatch.setattr("moveit6d.estimation.PoseDetector", lambda *_, **__: None)
        monkeypatch.setattr("moveit6d.cli.starting.first_pose", found)
        return asked

    return use


@pytest.fixture
def interrupt_update(monkeypatch: pytest.MonkeyPatch) -> Callable[[int], None]:
    """Presses Ctrl-C at the tracker's n-th frame, counted from 1 over all trackers."""
    update = PoseTracker.update

    def interrupt(number: int) -> None:
        calls = count(1)

        def stop(self: Any, image: Any) -> Any:
            if next(calls) == number:
                raise KeyboardInterrupt
            return update(self, image)

        monkeypatch.setattr(PoseTracker, "update", stop)

    return interrupt


@pytest.fixture
def clip(make_sequence: Make, scene: Any, use_oracle: Callable[..., None], tmp_path: Path) -> Clip:
    """A still brick, five frames, a start that is a little off, and a policy that knows better."""
    made = make_sequence("clip", frames=5, still=True)
    true = made.poses[0]
    off = torch.tensor([0.003, -0.002, 0.008], dtype=torch.float64)
    Pose(true.rotation, true.translation + off).save(made.folder / "start.json")
    use_oracle(scene.mesh, true)
    return Clip(made.folder, tmp_path / "out", true)


@pytest.fixture
def sequences(make_sequence: Make, scene: Any, use_oracle: Callable[..., None]) -> Path:
    """Two still sequences, and a policy that knows their pose."""
    for name in ("easy_00", "hard_01"):
        made = make_sequence(name, frames=4, still=True)
    use_oracle(scene.mesh, made.poses[0])
    folder: Path = made.folder.parent
    return folder


@pytest.fixture
def small(tmp_path: Path) -> list[str]:
    """Options for one procedural object and one picture."""
    folder = tmp_path / "photos"
    folder.mkdir()
    Image.fromarray(photos()[0]).save(folder / "0.png")
    return ["--set", f"data.photos={folder}", "--set", "data.shapes=1"]


@pytest.fixture(autouse=True)
def own_cache(monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory) -> None:
    """Prepared meshes are kept beside the tests, once for all of them."""
    base = tmp_path_factory.getbasetemp() / "cache"
    monkeypatch.setenv("XDG_CACHE_HOME", str(base))
