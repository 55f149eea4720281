"""A policy that knows the truth in place of the shipped weights."""

from __future__ import annotations

from collections.abc import Callable
from itertools import count
from typing import Any

import pytest

from moveit6d.estimation import PoseTracker
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy


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
