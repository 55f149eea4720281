"""What users hand over at the front door: right, or one sentence that names the type wanted."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from moveit6d import Camera, InputError, Mesh, OraclePolicy, Pose, PoseTracker, make_renderer
from moveit6d.config import PAPER_CONFIG
from moveit6d.estimation.inputs import (
    config_of,
    meshes_of,
    policy_of,
    renderer_of,
    start_poses_of,
)

POSE = Pose.from_rvec([0.1, -0.2, 0.3], [0.01, -0.02, 0.5])
MATRIX = POSE.matrix.numpy()


def test_meshes(brick: Mesh) -> None:
    assert meshes_of(brick) == meshes_of([brick]) == meshes_of((brick,)) == [brick]
    for bad in ("box.obj", ["box.obj"], None, np.eye(3)):
        with pytest.raises(InputError, match=r"must be a Mesh.*Mesh\.load"):
            meshes_of(bad)
    with pytest.raises(InputError, match="list of meshes is empty"):
        PoseTracker([], Camera(1, 1, 0, 0, 2, 2))


@pytest.mark.parametrize(
    ("tool", "bad", "words"),
    [
        (policy_of, "x.safetensors", r"Policy, found the text 'x\.safetensors'; load_policy"),
        (renderer_of, "pyrender", r"Renderer, found the text 'pyrender'; make_renderer.* embree"),
        (config_of, {"loop": {}}, "TrackerConfig, found dict"),
        (config_of, None, "TrackerConfig, found NoneType"),
    ],
)
def test_names_and_dicts_are_no_tools(tool: Any, bad: Any, words: str) -> None:
    with pytest.raises(InputError, match=words):
        tool(bad)


def test_tools_stay_as_they_are() -> None:
    policy, renderer = OraclePolicy(Pose.identity(1)), make_renderer()
    assert policy_of(policy) is policy and renderer_of(renderer) is renderer
    assert config_of(PAPER_CONFIG) is PAPER_CONFIG


def test_start_poses_are_as_many_as_meshes_and_may_be_missing() -> None:
    assert start_poses_of(None, 2) == [None, None]
    known = start_poses_of([None, MATRIX], 2)
    assert known[0] is None and known[1] is not None
    torch.testing.assert_close(known[1].matrix, POSE.matrix)
    assert len(start_poses_of([POSE, MATRIX], 2)) == 2
    with pytest.raises(InputError, match="3 meshes need as many start poses, found 2"):
        start_poses_of([POSE, None], 3)
    sheared = Pose(
        POSE.rotation @ torch.diag(torch.tensor([1.0, 1.0, 2.0]).double()), POSE.translation
    )
    with pytest.raises(InputError, match=r"^Start pose: the .*not a rotation"):
        start_poses_of([None, sheared], 2)
