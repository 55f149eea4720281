"""Multi-start refinement: only at low confidence, only where the camera sees, the best wins."""

import dataclasses
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from moveit6d.actions import pose_delta
from moveit6d.config import ActionMode, PerturbationConfig
from moveit6d.errors import InputError
from moveit6d.estimation import PoseEstimator, Target, refine_batch, refine_single
from moveit6d.estimation.multi_start import most_confident, refine_multi_start, sample_perturbations
from moveit6d.estimation.refine import refine_starts
from moveit6d.estimation.results import starts_of
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.rendering.backends import make_renderer
from tests.support.configs import HIGH_CONFIDENCE, LOOP_ONLY, NO_CONTOUR
from tests.support.meshes import colored_box
from tests.support.near_sighted import NearSighted, Numbered

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
GRAY = np.full((240, 320, 3), 90, np.uint8)
RENDERER = make_renderer()
BOX = colored_box()


def at(x: float, z: float = 0.7) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([x, 0.0, z], dtype=torch.float64))


def estimator(mesh: Mesh, policy: NearSighted, multi_start: bool = True) -> PoseEstimator:
    return PoseEstimator(
        mesh,
        CAMERA,
        policy=policy,
        renderer=RENDERER,
        config=NO_CONTOUR if multi_start else LOOP_ONLY,
    )


def test_another_start_finds_what_the_given_one_does_not(brick: Mesh) -> None:
    truth, far = brick.inner(at(0.012)), at(-0.035)  # 28 units away: too far for this policy
    alone = estimator(brick, NearSighted(truth, 21.0), multi_start=False).refine(GRAY, far)
    assert alone.pose is not None and alone.confidence < HIGH_CONFIDENCE
    torch.testing.assert_close(alone.pose.matrix, far.matrix)
    found = estimator(brick, NearSighted(truth, 21.0)).refine(GRAY, far)
    assert found.pose is not None and found.confidence == pytest.approx(0.95)
    torch.testing.assert_close(found.pose.matrix, at(0.012).matrix)


def test_how_low_the_confidence_must_be_is_a_setting(brick: Mesh) -> None:
    multi_start = dataclasses.replace(NO_CONTOUR.multi_start, below=0.0)
    config = dataclasses.replace(NO_CONTOUR, multi_start=multi_start)
    policy, far = NearSighted(brick.inner(at(0.012)), 21.0), at(-0.035)
    found = PoseEstimator(brick, CAMERA, policy=policy, renderer=RENDERER, config=config)
    pose = found.refine(GRAY, far).pose
    assert pose is not None
    torch.testing.assert_close(pose.matrix, far.matrix)


def test_a_confident_result_is_not_touched(brick: Mesh) -> None:
    truth = brick.inner(at(0.004))
    with_multi_start, without = NearSighted(truth, 30.0), NearSighted(truth, 30.0)
    found = estimator(brick, with_multi_start).refine(GRAY, at(0.0))
    assert found.pose is not None
    assert with_multi_start.asked == found.iterations + 7, "the last iteration is augmented"
    same = estimator(brick, without, multi_start=False).refine(GRAY, at(0.0))
    assert same.pose is not None
    torch.testing.assert_close(found.pose.matrix, same.pose.matrix, rtol=0, atol=0)


def test_in_vain_it_keeps_the_pose_from_the_given_start(brick: Mesh) -> None:
    blind = NearSighted(brick.inner(at(0.0)), reach=0.0)
    result = estimator(brick, blind).refine(GRAY, at(0.01))
    assert result.pose is not None and blind.asked > 20
    torch.testing.assert_close(result.pose.matrix, at(0.01).matrix)


def test_each_of_many_targets_has_the_result_it_has_alone(brick: Mesh) -> None:
    truth = brick.inner(at(0.012))
    targets = [Target(GRAY, CAMERA, brick, at(x)) for x in (0.012, -0.035, 0.02)]

    def refined(some: list[Target]) -> list[Pose | None]:
        policy = NearSighted(truth, 21.0)
        return [
            result.pose
            for result in refine_single(some, policy=policy, renderer=RENDERER, config=NO_CONTOUR)
        ]

    together = refined(targets)
    for target, pose in zip(targets, together, strict=True):
        (alone,) = refined([target])
        assert pose is not None and alone is not None
        torch.testing.assert_close(pose.matrix, alone.matrix)


def test_the_most_confident_end_wins_and_pays_for_the_others(brick: Mesh) -> None:
    truth = brick.inner(at(0.012))
    policy = NearSighted(truth, 21.0)
    starts = starts_of([Target(GRAY, CAMERA, brick, at(x)) for x in (0.012, -0.035)])
    results = refine_starts(starts, policy=policy, renderer=RENDERER)
    sure, found = most_confident(
        results, [[], starts], policy=policy, renderer=RENDERER, config=NO_CONTOUR
    )
    assert sure is results[0]
    assert found.centred is not None and found.confidence == results[0].confidence
    torch.testing.assert_close(found.centred.matrix, truth.matrix)
    assert found.milliseconds > results[1].milliseconds


def test_other_starts_are_known_by_their_objects_numbers(brick: Mesh) -> None:
    policy = Numbered(brick.inner(at(0.012)), 21.0)
    starts = starts_of([Target(GRAY, CAMERA, brick, at(0.012))])
    results = refine_starts(starts, policy=policy, renderer=RENDERER)
    tools: Any = {"policy": policy, "renderer": RENDERER, "config": NO_CONTOUR}
    for race in (False, True):
        for numbers, expected in ((None, {1}), ([3, 5], {5})):
            policy.numbers.clear()
            most_confident(results * 2, [[], starts * 2], race=race, targets=numbers, **tools)
            assert policy.numbers == expected


def test_the_papers_policy_does_not_search(brick: Mesh) -> None:
    targets = [Target(GRAY, CAMERA, brick, at(0.0))]
    policy = NearSighted(brick.inner(at(0.0)), 0.0, mode=ActionMode.SINGLE)
    once = NearSighted(brick.inner(at(0.0)), 0.0, mode=ActionMode.SINGLE)
    refine_multi_start(starts_of(targets), policy=policy, renderer=RENDERER, config=NO_CONTOUR)
    refine_batch(targets, policy=once, renderer=RENDERER)
    assert policy.asked == once.asked


def test_a_start_out_of_sight_is_refused_as_without_search(brick: Mesh) -> None:
    with pytest.raises(InputError, match="outside"):
        estimator(brick, NearSighted(brick.inner(at(0.0)), 1.0)).refine(GRAY, at(5.0))


def test_at_the_edge_of_the_picture_places_out_of_sight_are_left_out(brick: Mesh) -> None:
    edge = at(0.4)  # half of it is still in the picture
    blind = NearSighted(brick.inner(edge), reach=0.0)
    assert estimator(brick, blind).refine(GRAY, edge).pose is not None


@settings(max_examples=30, deadline=None)
@given(st.integers(0, 10_000), st.floats(0.0, 20.0), st.floats(0.1, 25.0))
def test_a_place_beside_is_as_far_as_asked(seed: int, shift: float, turn: float) -> None:
    mesh = BOX
    shifts = (shift, shift / 2, shift / 4)
    around = PerturbationConfig(1, shifts, (turn, 2 * turn))
    (other,) = sample_perturbations(mesh, mesh.inner(at(0.02)), np.random.default_rng(seed), around)
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    delta = pose_delta(mesh.inner(at(0.02)), other, diameter).numpy()
    assert (np.abs(delta[:3]) <= np.array(shifts) + 1e-9).all()
    assert turn - 1e-6 <= np.linalg.norm(delta[3:]) <= 2 * turn + 1e-6


def test_in_a_race_only_the_most_confident_start_goes_on(brick: Mesh) -> None:
    policy = NearSighted(brick.inner(at(0.0)), 60.0)
    targets = [Target(GRAY, CAMERA, brick, at(x)) for x in (0.03, 0.02, -0.025)]
    results = refine_starts(starts_of(targets[:1]), policy=policy, renderer=RENDERER)
    low = dataclasses.replace(results[0], confidence=0.1)
    asked = []
    for race in (False, True):
        policy.asked = 0
        (found,) = most_confident(
            [low],
            [starts_of(targets)],
            policy=policy,
            renderer=RENDERER,
            config=NO_CONTOUR,
            race=race,
        )
        assert found.confidence == pytest.approx(0.95)
        asked.append(policy.asked)
    assert asked[0] % 3 == 0 and asked[1] == 3 + (asked[0] - 3) // 3


def test_a_race_is_not_cut_where_a_batch_ends(brick: Mesh) -> None:
    policy = NearSighted(brick.inner(at(0.0)), 60.0)
    starts = starts_of([Target(GRAY, CAMERA, brick, at(x)) for x in (0.03, 0.02, -0.025)])
    low = dataclasses.replace(
        refine_starts(starts[:1], policy=policy, renderer=RENDERER)[0], confidence=0.1
    )
    asked = []
    for size in (2, 4, 32):
        multi_start = dataclasses.replace(NO_CONTOUR.multi_start, batch_size=size)
        config = dataclasses.replace(NO_CONTOUR, multi_start=multi_start)
        policy.asked = 0
        found = most_confident(
            [low, low], [starts, starts], policy=policy, renderer=RENDERER, config=config, race=True
        )
        assert [one.confidence for one in found] == [pytest.approx(0.95)] * 2
        asked.append(policy.asked)
    assert asked == [asked[-1]] * 3, "of each object one start goes on"
