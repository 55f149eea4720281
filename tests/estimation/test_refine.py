"""The loop with the oracle: it reaches the truth, and each stop rule ends it as the paper says."""

import re
from dataclasses import replace

import cv2
import numpy as np
import pytest
import torch
import trimesh

from moveit6d.actions import PoseAction, pose_delta
from moveit6d.config import ActionMode, LoopConfig
from moveit6d.errors import RenderingUnavailable
from moveit6d.estimation import StopReason, Target, refine_batch
from moveit6d.estimation.refine import once_more, refine_starts
from moveit6d.estimation.results import Start, starts_of
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.crop import Crop
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import random_rotations
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.observation import Observation
from moveit6d.policies import LoopState, OraclePolicy
from moveit6d.rendering.backends import make_renderer
from moveit6d.rendering.renderer import Renderer
from moveit6d.synthesis.training.clusters import ClusterConfig, draw_delta
from tests.support.configs import limited

CAMERA = Camera(600, 600, 319.5, 239.5, 640, 480)
IMAGE = np.random.default_rng(0).integers(0, 255, (480, 640, 3), dtype=np.uint8)


def some_targets(
    mesh: Mesh, number: int, seed: int = 0, cluster: str | None = None
) -> tuple[list[Target], Pose]:
    """Targets whose start is a random cluster away from the truth, and the centred truth."""
    random = np.random.default_rng(seed)
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    truth = Pose(
        random_rotations(number, torch.Generator().manual_seed(seed)),
        torch.from_numpy(random.uniform([-0.08, -0.06, 0.6], [0.08, 0.06, 1.2], (number, 3))),
    )
    delta = np.stack([draw_delta(random, ClusterConfig(), cluster) for _ in range(number)])
    start = PoseAction.from_delta(torch.from_numpy(delta)).apply_centred(
        truth, diameter.expand(number)
    )
    return [Target(IMAGE, CAMERA, mesh, mesh.outer(start[i])) for i in range(number)], truth


def counts_left(mesh: Mesh, pose: Pose | None, truth: Pose) -> float:
    assert pose is not None
    diameter = torch.tensor(mesh.sphere_diameter, dtype=torch.float64)
    return float(pose_delta(mesh.inner(pose), truth, diameter).abs().max())


def renderer_or_skip(name: str) -> Renderer:
    try:
        return make_renderer(name)
    except RenderingUnavailable as error:
        pytest.skip(str(error))


@pytest.mark.parametrize("name", ["embree", "pyrender"])
@pytest.mark.parametrize("mode", list(ActionMode))
def test_the_oracle_reaches_the_truth(brick: Mesh, name: str, mode: ActionMode) -> None:
    renderer = renderer_or_skip(name)
    number = 12 if mode is ActionMode.ALL_AXES else 3
    targets, truth = some_targets(brick, number)
    results = refine_batch(
        targets, policy=OraclePolicy(truth, mode), renderer=renderer, loop=limited(200)
    )
    for i, result in enumerate(results):
        assert result.stopped_by is StopReason.STOP_ACTION
        assert counts_left(brick, result.pose, truth[i]) < 0.5 + 1e-9


@pytest.mark.parametrize("mode", list(ActionMode))
def test_a_policy_of_axis_parallel_crops_reaches_the_truth_as_well(
    brick: Mesh, mode: ActionMode
) -> None:
    targets, truth = some_targets(brick, 3)
    policy = OraclePolicy(truth, mode, "axis_parallel")
    results = refine_batch(targets, policy=policy, renderer=make_renderer(), loop=limited(200))
    for i, result in enumerate(results):
        assert result.stopped_by is StopReason.STOP_ACTION
        assert counts_left(brick, result.pose, truth[i]) < 0.6  # counted in the other crop


def test_what_a_policy_of_axis_parallel_crops_sees_lies_on_what_is_rendered(brick: Mesh) -> None:
    """Beside the image's middle, too: the object's silhouette in the picture and the rendering."""
    _, truth = some_targets(brick, 1)
    direction = torch.tensor([-0.35, 0.25, 1.0], dtype=torch.float64)
    pose = Pose(truth[0].rotation, direction * 4 * brick.sphere_diameter)
    corners = torch.from_numpy(brick.vertices).double()
    pixels = CAMERA.project(pose.transform(corners)).numpy().round().astype(np.int32, "C")
    image = np.zeros((480, 640, 3), np.uint8)
    cv2.fillConvexPoly(image, cv2.convexHull(pixels), (255, 255, 255))
    shown = []

    class Witness(OraclePolicy):
        def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
            shown.append(((seen.image[0, 0] > 0.5), seen.mask[0, 0] > 0.5))
            return super().predict(seen, state)

    policy = Witness(pose[None], ActionMode.ALL_AXES, "axis_parallel")
    target = Target(image, CAMERA, brick, brick.outer(pose))
    refine_batch([target], policy=policy, renderer=make_renderer(), loop=limited(1))
    photographed, rendered = shown[0]
    assert (photographed & rendered).sum() > 0.95 * (photographed | rendered).sum()


def test_a_result_can_be_optimised_further(brick: Mesh) -> None:
    """The loop itself runs without autograd; what it returns are tensors like any others."""
    targets, truth = some_targets(brick, 1)
    results = refine_batch(targets, policy=OraclePolicy(truth), renderer=make_renderer())
    pose = results[0].pose
    assert pose is not None
    shift = torch.zeros(3, dtype=torch.float64, requires_grad=True)
    moved = Pose(pose.rotation, pose.translation + shift)
    moved.transform(torch.ones(5, 3, dtype=torch.float64)).square().sum().backward()
    assert shift.grad is not None and bool((shift.grad != 0).any())
    pose.translation.mul_(2.0)


def test_all_axes_need_a_move_a_look_and_a_close_look(brick: Mesh) -> None:
    targets, truth = some_targets(brick, 5, cluster="all_large")
    policy = OraclePolicy(truth, ActionMode.ALL_AXES)
    results = refine_batch(targets, policy=policy, renderer=make_renderer())
    assert [result.iterations for result in results] == [3] * 5


class Onlooker(OraclePolicy):
    """Knows the truth, or walks on by `walk` units to the right, and notes what it is shown."""

    def __init__(self, truth: Pose, mode: ActionMode, walk: float = 0.0) -> None:
        super().__init__(truth, mode)
        self.walk = walk
        self.widths: list[float] = []  # of the object in the patch, pixels
        self.diameters: list[float] = []

    def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
        self.diameters.append(float(state.sphere_diameter[0]))
        self.widths.append(float(seen.mask[0].sum()) ** 0.5)
        if not self.walk:
            return super().predict(seen, state)
        delta = torch.zeros(len(seen), 6)
        delta[:, 0] = self.walk
        return PolicyOutput(torch.zeros(len(seen), 13), delta, torch.ones(len(seen)))


def looks(
    brick: Mesh, policy: Onlooker, start: Start, max_iterations: int | None = None
) -> list[bool]:
    """Which iterations were shown the middle of the object."""
    loop = LoopConfig(max_iterations=max_iterations)
    refine_starts([start], policy=policy, renderer=make_renderer(), loop=loop)
    fine = [diameter < 0.99 * brick.sphere_diameter for diameter in policy.diameters]
    for diameter in policy.diameters:
        part = brick.sphere_diameter / diameter
        assert part == pytest.approx(1) or part == pytest.approx(LoopConfig().fine_scale)
    return fine


def test_whoever_comes_close_looks_closely_and_sees_more_of_less(brick: Mesh) -> None:
    targets, truth = some_targets(brick, 1, cluster="all_large")
    policy = Onlooker(truth, ActionMode.ALL_AXES)
    assert looks(brick, policy, starts_of(targets)[0]) == [False, False, True]
    assert policy.widths[2] > 1.2 * policy.widths[1]


def test_a_start_that_is_known_to_be_close_is_looked_at_closely_at_once(brick: Mesh) -> None:
    targets, truth = some_targets(brick, 1, cluster="near")
    fine = replace(starts_of(targets)[0], fine=True)
    assert all(looks(brick, Onlooker(truth, ActionMode.ALL_AXES), fine))


def test_the_last_iteration_is_fine_even_without_a_small_delta(brick: Mesh) -> None:
    targets, truth = some_targets(brick, 1, cluster="near")
    walker = Onlooker(truth, ActionMode.ALL_AXES, walk=1.5 * LoopConfig().fine_threshold)
    assert looks(brick, walker, starts_of(targets)[0], 4) == [False, False, False, True]


def test_single_actions_have_no_fine_stage(brick: Mesh) -> None:
    targets, truth = some_targets(brick, 1, cluster="all_small")
    fine = replace(starts_of(targets)[0], fine=True)
    assert not any(looks(brick, Onlooker(truth, ActionMode.SINGLE), fine))


def test_the_limit_of_steps_ends_a_loop(brick: Mesh) -> None:
    targets, truth = some_targets(brick, 2, cluster="all_large")
    results = refine_batch(
        targets, policy=OraclePolicy(truth), renderer=make_renderer(), loop=limited(4)
    )
    assert [(r.iterations, r.stopped_by) for r in results] == [(4, StopReason.MAX_ITERATIONS)] * 2


class Scripted:
    """Plays given actions with given confidences."""

    mode = ActionMode.SINGLE
    crop: Crop = "look_at"

    def __init__(self, actions: list[int], confidences: list[float]) -> None:
        self.script = list(zip(actions, confidences, strict=True))

    def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
        action, confidence = self.script.pop(0)
        logits = torch.nn.functional.one_hot(torch.tensor([action]), 13).float()
        return PolicyOutput(logits, None, torch.tensor([confidence]))


def test_an_oscillation_ends_at_its_most_confident_pose(brick: Mesh) -> None:
    """Right, right, left: the third pose is the first again; the second was the best."""
    targets, _ = some_targets(brick, 1)
    policy = Scripted([0, 0, 1, 0], [0.1, 0.9, 0.3, 0.2])
    result = refine_batch(targets, policy=policy, renderer=make_renderer())[0]
    assert result.stopped_by is StopReason.REVISITED and result.iterations == 3
    assert result.confidence == pytest.approx(0.9)
    start = brick.inner(targets[0].pose)
    assert result.pose is not None
    diameter = torch.tensor(brick.sphere_diameter, dtype=torch.float64)
    moved = pose_delta(start, brick.inner(result.pose), diameter)
    assert moved[0].item() == pytest.approx(2, abs=0.02)


def test_stop_keeps_the_pose(brick: Mesh) -> None:
    targets, _ = some_targets(brick, 1)
    result = refine_batch(targets, policy=Scripted([12], [0.5]), renderer=make_renderer())[0]
    assert result.stopped_by is StopReason.STOP_ACTION and result.iterations == 1
    assert result.pose is not None
    torch.testing.assert_close(result.pose.matrix, targets[0].pose.matrix)


class RunsAway(Scripted):
    """Moves the object into the camera."""

    mode = ActionMode.ALL_AXES
    crop: Crop = "look_at"

    def __init__(self) -> None:
        super().__init__([], [])

    def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
        delta = torch.tensor([[0, 0, 5000.0, 0, 0, 0]] * len(seen))
        return PolicyOutput(torch.zeros(len(seen), 13), delta, torch.ones(len(seen)))


def test_a_pose_that_leaves_the_view_fails_with_a_sentence(brick: Mesh) -> None:
    targets, _ = some_targets(brick, 1)
    result = refine_batch(targets, policy=RunsAway(), renderer=make_renderer())[0]
    assert result.stopped_by is StopReason.FAILED and result.pose is None
    assert result.error is not None and "lost" in result.error


def test_nothing_to_do_gives_nothing(brick: Mesh) -> None:
    assert refine_batch([], policy=Scripted([], []), renderer=make_renderer()) == []


@pytest.mark.parametrize(
    ("place", "message"),
    [
        ([0, 0, -1], "behind the camera"),
        ([2, 0, 1], "outside of the image"),
        ([0, 0, 0.01], "inside the object"),
        ([0, 0, 1000], "unit of the mesh"),
        ([0, 0, float("nan")], "not finite"),
    ],
)
def test_starts_out_of_sight_fail_alone(brick: Mesh, place: list[float], message: str) -> None:
    pose = brick.outer(Pose(torch.eye(3).double(), torch.tensor(place, dtype=torch.float64)))
    target = Target(IMAGE, CAMERA, brick, pose)
    seen, truth = some_targets(brick, 1, cluster="near")
    failed, fine = refine_batch(
        [target, *seen], policy=OraclePolicy(Pose.stack([truth[0]] * 2)), renderer=make_renderer()
    )
    assert failed.pose is None and failed.stopped_by is StopReason.FAILED
    assert failed.error is not None and re.search(message, failed.error)
    assert fine.pose is not None, "one start that cannot be seen fails alone"


@pytest.mark.parametrize("step_size", [0.2, 0.4, 3.0])
def test_single_actions_of_any_length_reach_the_truth(brick: Mesh, step_size: float) -> None:
    targets, truth = some_targets(brick, 3, cluster="all_small")
    results = refine_batch(
        targets,
        policy=OraclePolicy(truth, ActionMode.SINGLE),
        renderer=make_renderer(),
        loop=limited(200, step_size),
    )
    for i, result in enumerate(results):
        assert counts_left(brick, result.pose, truth[i]) < 0.5 + step_size


def test_rows_may_be_of_any_targets(brick: Mesh) -> None:
    targets, truth = some_targets(brick, 3, cluster="all_small")
    tools = {"policy": OraclePolicy(truth, ActionMode.ALL_AXES), "renderer": make_renderer()}
    starts = starts_of([targets[2], targets[1], targets[2]])
    for one, target in zip(
        refine_starts(starts, targets=[2, 1, 2], **tools), (2, 1, 2), strict=True
    ):
        assert one.centred is not None
        assert counts_left(brick, brick.outer(one.centred), truth[target]) < 0.5
    results = [
        replace(one, centred=None if i == 0 else one.centred)
        for i, one in enumerate(refine_starts(starts_of(targets), **tools))
    ]
    again = once_more(starts_of(targets), results, loop=LoopConfig(), **tools)
    assert sorted(again) == [1, 2]
    for target, one in again.items():
        assert one.centred is not None
        assert counts_left(brick, brick.outer(one.centred), truth[target]) < 0.5


class _Knowing(OraclePolicy):
    """Is the more confident the shorter the delta."""

    def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
        prediction = super().predict(seen, state)
        assert prediction.delta is not None
        belief = torch.exp(-prediction.delta.abs().amax(-1))
        return PolicyOutput(prediction.logits, prediction.delta, belief)


def test_of_several_starts_the_most_confident_goes_on(brick: Mesh) -> None:
    far, truth = some_targets(brick, 2, cluster="all_large")
    near, _ = some_targets(brick, 2, cluster="all_small")
    targets = [far[0], near[0], near[1], far[1]]
    policy = _Knowing(truth)
    renderer = make_renderer("embree")
    results = refine_starts(
        starts_of(targets),
        policy=policy,
        renderer=renderer,
        loop=limited(200),
        groups=[0, 0, 1, 1],
    )
    alone = refine_batch(near, policy=policy, renderer=renderer, loop=limited(200))
    assert [result.iterations for result in results] == [result.iterations for result in alone]
    for i, result in enumerate(results):
        assert result.centred is not None
        assert counts_left(brick, brick.outer(result.centred), truth[i]) < 0.5


def test_nobody_is_sure_of_what_the_rendering_does_not_show() -> None:
    sheet = trimesh.creation.box((0.3, 0.2, 0.0005))
    mesh = Mesh.from_arrays("sheet", sheet.vertices, sheet.faces)
    poses = [Pose.from_rvec([np.radians(turn), 0, 0], [0, 0, 0.5]) for turn in (90, 45)]
    targets = [Target(IMAGE, CAMERA, mesh, pose) for pose in poses]
    policy = Onlooker(mesh.inner(Pose.stack(poses)), ActionMode.ALL_AXES)
    edge_on, seen = refine_batch(targets, policy=policy, renderer=make_renderer())
    assert (edge_on.confidence, seen.confidence) == (0.0, 1.0)
