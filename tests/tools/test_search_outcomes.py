"""What the fit of the confidence learns from: features, outcomes, pictures within photographs."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch

from moveit6d import Mesh, Pose, load_policy, make_renderer
from moveit6d.frame import prepare_frame
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.weights_file import load_network
from moveit6d.policies import SHIPPED_WEIGHTS, LoopState
from tests.support import pictures
from tests.support.observations import an_observation
from tools.search_outcomes import (
    Outcomes,
    Recorder,
    Target,
    _refined,
    candidates,
    near_starts,
)

TRUTH = Pose(torch.eye(3).double(), torch.tensor([0.02, -0.01, 0.5], dtype=torch.float64))


@pytest.fixture(scope="module")
def recorder() -> Recorder:
    network = load_network(SHIPPED_WEIGHTS).network
    assert isinstance(network, CompactCorrelationNet)
    return Recorder(network)


def test_a_recorder_answers_as_the_policy_and_keeps_what_the_confidence_was_told(
    recorder: Recorder,
) -> None:
    seen = an_observation(3)
    poses = Pose.stack([TRUTH] * 3)
    state = LoopState(poses, torch.ones(3), torch.tensor([4, 5, 6]))
    recorder.forget()
    mine, its = (policy.predict(seen, state) for policy in (recorder, load_policy()))
    assert mine.delta is not None and its.delta is not None
    torch.testing.assert_close(mine.delta, its.delta, atol=0.05, rtol=0.05)
    assert [row for row, _, _ in recorder.seen] == [4, 5, 6]
    assert len(recorder.poses) == 3
    plain = recorder.network.folded.network
    assert isinstance(plain, CompactCorrelationNet)
    told = torch.stack([features for _, features, _ in recorder.seen]).float()
    said = torch.sigmoid(plain.confidence_head(told)[:, 0])
    torch.testing.assert_close(said, mine.confidence, atol=0.01, rtol=0.01)


def test_loops_from_near_end_right_and_those_of_another_place_do_not(
    brick: Mesh, recorder: Recorder
) -> None:
    frame = prepare_frame(pictures.picture(brick, TRUTH).permute(1, 2, 0), pictures.CAMERA)
    target = Target(brick, brick.outer(TRUTH))
    aside = Pose(TRUTH.rotation, TRUTH.translation + torch.tensor([0.15, 0.12, 0.0]).double())
    found = _refined(frame, target, [TRUTH, aside], 1, recorder, make_renderer(), 7)
    assert found.features.shape == (len(found.right), 185)
    assert found.right[found.searched].all() and not found.right[~found.searched].any()
    assert found.last.sum() == 2
    assert set(found.picture.tolist()) == {7}


def test_candidates_are_those_of_a_search_and_near_starts_are_near(
    brick: Mesh, recorder: Recorder
) -> None:
    frame = prepare_frame(pictures.picture(brick, TRUTH).permute(1, 2, 0), pictures.CAMERA)
    found = candidates(frame, brick, recorder, make_renderer())
    assert 2 <= len(found) <= 40
    nearest = min(float((pose.translation - TRUTH.translation).norm()) for pose in found)
    assert nearest < 0.1
    near = near_starts(np.random.default_rng(0), Target(brick, brick.outer(TRUTH)))
    assert len(near) == 6
    assert all(float((pose.translation - TRUTH.translation).norm()) < 0.3 for pose in near)


def test_outcomes_come_back_from_a_file(tmp_path: Path) -> None:
    rows = 4
    told = Outcomes(
        np.arange(rows * 2, dtype=np.float16).reshape(rows, 2),
        np.linspace(0, 1, rows, dtype=np.float32),
        np.array([True, False, True, False]),
        np.array([True, True, False, False]),
        np.array([False, True, False, True]),
        np.full(rows, 3),
    )
    told.save(tmp_path / "a.npz")
    back = Outcomes.joined([Outcomes.load(tmp_path / "a.npz"), told.part(told.right)])
    np.testing.assert_array_equal(back.features[:rows], told.features)
    np.testing.assert_array_equal(back.features[rows:], told.features[[0, 2]])
    assert back.right.tolist() == [True, False, True, False, True, True]
