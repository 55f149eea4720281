"""Synthetic refinement: starts as far away as asked for, and the oracle finds back."""

from dataclasses import replace

import numpy as np

from moveit6d.config import ActionMode, LoopConfig
from moveit6d.evaluation.synthetic_refinement import LOOP_ONLY, run_cases
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from moveit6d.rendering.backends import make_renderer
from moveit6d.synthesis.single_images import make_cases

GREY = [np.full((120, 160, 3), 128, np.uint8)]
CONFIG = replace(LOOP_ONLY, loop=LoopConfig(max_iterations=5))


def test_the_start_is_a_small_delta_away_and_the_oracle_finds_back(brick: Mesh) -> None:
    renderer = make_renderer()
    cases = list(
        make_cases([brick], GREY, renderer, cluster="all_small", occluded=0.0, number=4, seed=1)
    )
    truth = Pose.stack([brick.inner(case.truth) for case in cases])
    policy = OraclePolicy(truth, ActionMode.ALL_AXES)
    found = list(run_cases(cases, policy, renderer, CONFIG))
    assert all(0.01 < refined.before < 0.8 for refined in found)
    assert all(refined.after < 1e-6 for refined in found)
