"""Rendered cases: the object is where the truth says, covers cover, the oracle solves them."""

from dataclasses import replace

import numpy as np
import torch

from moveit6d.config import ActionMode, LoopConfig
from moveit6d.evaluation.default_camera import CAMERA
from moveit6d.evaluation.synthetic_refinement import LOOP_ONLY, make_cases, run_cases
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from moveit6d.rendering.backends import make_renderer

GREY = [np.full((120, 160, 3), 128, np.uint8)]

CONFIG = replace(LOOP_ONLY, loop=LoopConfig(max_iterations=5))


def some_cases(brick: Mesh, occluded: float = 0.0) -> list:  # type: ignore[type-arg]
    return list(
        make_cases(
            [brick], GREY, make_renderer(), cluster="all_small", occluded=occluded, number=4, seed=1
        )
    )


def test_the_object_is_drawn_at_the_true_pose(brick: Mesh) -> None:
    """Where the picture is not the grey photo, and only there, the renderer sees the object."""
    for case in some_cases(brick):
        image = case.target.image.float()
        chroma = image.amax(-1) - image.amin(-1)
        pose = brick.inner(case.truth)
        batch = Pose(pose.rotation[None], pose.translation[None])
        buffer = make_renderer().render([brick], batch, CAMERA.matrix[None], 640)
        mask = buffer.mask[0, 0, :480] > 0
        assert chroma[mask].median() > 30 > chroma[~mask].median()


def test_the_start_is_small_counts_away_and_the_oracle_finds_back(brick: Mesh) -> None:
    cases = some_cases(brick)
    truth = Pose.stack([brick.inner(case.truth) for case in cases])
    policy = OraclePolicy(truth, ActionMode.ALL_AXES)
    outcomes = list(run_cases(cases, policy, make_renderer(), CONFIG))
    assert all(0.01 < refined.before < 0.8 for refined in outcomes)
    assert all(refined.after < 1e-6 for refined in outcomes)


def test_covering_changes_the_picture(brick: Mesh) -> None:
    plain, occluded = some_cases(brick)[0], some_cases(brick, 1.0)[0]
    assert not torch.equal(plain.target.image, occluded.target.image)
