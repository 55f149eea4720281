"""Objects are looked for where no start of theirs is of any use, and only there."""

from __future__ import annotations

from typing import Any

import pytest
import torch

from moveit6d.config import LoopConfig, RecoveryConfig, TrackerConfig
from moveit6d.estimation import Target, refine_single, search_lost_targets
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy, load_policy
from moveit6d.rendering.embree import EmbreeRenderer


@pytest.fixture(scope="module")
def tools() -> dict[str, Any]:
    return {"policy": load_policy(), "renderer": EmbreeRenderer()}


@pytest.fixture
def behind(scene: Any) -> Target:
    true = scene.pose(0)
    pose = Pose(true.rotation, true.translation * torch.tensor([1, 1, -1]).double())
    return Target(scene.image(0), scene.camera, scene.mesh, pose)


def searched(targets: list[Target], tools: dict[str, Any], **settings: Any) -> dict[int, Any]:
    config = TrackerConfig(**settings)
    results = refine_single(targets, config=config, **tools)
    return search_lost_targets(targets, results, config=config, **tools)


def test_an_object_behind_the_camera_is_found_where_it_is(
    scene: Any, behind: Target, tools: dict[str, Any]
) -> None:
    found = searched([behind], tools)
    assert list(found) == [0]
    error = (found[0].pose.translation - scene.pose(0).translation).norm()
    assert float(error) < 0.1 * scene.mesh.diameter and found[0].confidence > 0.5


def test_where_another_row_knows_the_object_nothing_is_looked_for(
    scene: Any, behind: Target, tools: dict[str, Any]
) -> None:
    known = Target(behind.image, behind.camera, behind.mesh, scene.pose(0))
    assert searched([behind, known], tools) == {}


@pytest.mark.parametrize(
    "settings",
    [{"recovery": RecoveryConfig(enabled=False)}, {"loop": LoopConfig(mode="single")}],
)
def test_who_does_not_want_a_search_gets_none(
    behind: Target, tools: dict[str, Any], settings: dict[str, Any]
) -> None:
    assert searched([behind], tools, **settings) == {}


def test_a_policy_without_descriptors_cannot_search(
    scene: Any, behind: Target, tools: dict[str, Any]
) -> None:
    oracle = OraclePolicy(Pose.stack([scene.mesh.inner(scene.pose(0))]))
    assert searched([behind], tools | {"policy": oracle}) == {}
