"""Recovery: an object that goes away is lost, has no pose, and is found where it comes back."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d import InputError, Mesh, OraclePolicy, Pose, PoseTracker, load_policy
from moveit6d.config import (
    DetectorConfig,
    MultiStartConfig,
    RecoveryConfig,
    StateConfig,
    TrackerConfig,
)
from moveit6d.estimation import StopReason, TrackingResult
from moveit6d.estimation.detection import Detection, Evidence, FoundPose
from moveit6d.estimation.detection.steps import Steps
from moveit6d.estimation.recovery import Supervisor
from moveit6d.estimation.results import Refined, Start
from moveit6d.estimation.states import TrackingState, probability_of
from moveit6d.frame import Frame
from tests.support.configs import LOOP_ONLY

CORNERS = [[0, 0, 0], [0.1, 0, 0], [0, 0.1, 0], [0, 0, 0.1]]
MESH = Mesh.from_arrays("corner", CORNERS, [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]])
FRAME = Frame(torch.zeros(3, 4, 4, dtype=torch.uint8), None)  # type: ignore[arg-type]
POSE = Pose(torch.eye(3, dtype=torch.float64), torch.tensor([0.0, 0.0, 1.0], dtype=torch.float64))


def found_at(pose: Pose) -> Detection:
    result = TrackingResult(pose, 1, StopReason.MAX_ITERATIONS, 0.9, 1.0)
    return Detection((FoundPose(result, Evidence(0.9, 0.9)),))


class Finder:
    """A detector that takes `length` steps and finds the object in its n-th search."""

    mesh: Any = MESH
    config, settings = DetectorConfig(), TrackerConfig()
    policy = renderer = None

    def __init__(self, length: int, finds: int) -> None:
        self.length, self.finds, self.searches = length, finds, 0
        self.near: list[bool] = []
        self.taken: list[tuple[Pose, ...]] = []
        self.distances: list[tuple[float, float] | None] = []
        self.frames: list[Frame] = []

    def steps(self, frame: Any, region: Any = None, given: Any = (), most: int = 0) -> Steps:
        self.searches += 1
        near = region is not None and region.near is not None
        assert most == (16 if near else 40)
        self.near.append(near)
        self.taken.append(() if region is None else region.taken)
        self.distances.append(None if region is None else region.distance)
        self.frames.append(frame)
        for _ in range(self.length):
            yield
        return Detection(()) if self.searches < self.finds else found_at(POSE)


@pytest.fixture
def stays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever is followed through later frames stays where it is."""
    from moveit6d.estimation import catch_up

    def refined(starts: Sequence[Start], **_: Any) -> list[Refined]:
        return [Refined(starts[0].centred, 1, StopReason.MAX_ITERATIONS, 0.9, 1.0)]

    monkeypatch.setattr(catch_up, "refine_starts", refined)


def supervisor(finder: Finder, **options: Any) -> Supervisor:
    states = StateConfig(frames_to_lose=1)
    return Supervisor(finder, RecoveryConfig(states=states, **options), True)  # type: ignore[arg-type]


def test_near_first_then_the_whole_image_now_and_then() -> None:
    finder = Finder(length=5, finds=4)
    one = supervisor(finder, first_interval=3, interval=3)
    assert not one.lost
    assert one.assessed(failed(), 0.0).state is TrackingState.LOST and one.lost
    found = [one.search(FRAME, POSE) is not None for _ in range(10)]
    # Near at once, then everywhere in every third frame.
    assert finder.near == [True, False, False, False]
    assert found == [False] * 9 + [True]


def test_an_interval_of_one_is_a_search_in_every_frame_also_after_the_object_was_tracked() -> None:
    finder = Finder(length=2, finds=9)
    one = supervisor(finder, interval=1)
    sure = TrackingResult(POSE, 1, StopReason.MAX_ITERATIONS, 1.0, 1.0)
    assert one.assessed(sure, 1.0).state is TrackingState.TRACKING
    assert one.assessed(failed(), 0.0).state is TrackingState.LOST
    for frames in range(1, 5):
        one.search(FRAME, POSE)
        assert finder.searches == frames


@pytest.mark.usefixtures("stays")
@pytest.mark.parametrize(("stride", "frames"), [(1, None), (2, 9), (5, 6), (99, 6)])
def test_a_search_may_take_several_frames_and_more_to_come_to_the_present_one(
    stride: int, frames: int | None
) -> None:
    finder = Finder(length=5, finds=1)
    one = supervisor(finder, max_milliseconds=0.0, stride=stride)
    one.assessed(failed(), 0.0)
    found = [one.search(FRAME, POSE) is not None for _ in range(frames or 12)]
    assert finder.searches == 1
    # Of one frame at a time, each of which takes longer than the next needs to come, it never does.
    assert found.index(True) + 1 == frames if frames else not any(found)


def test_a_known_distance_holds_for_every_search() -> None:
    for distance in (None, (0.3, 0.8)):
        finder = Finder(length=1, finds=99)
        one = supervisor(finder, interval=1, distance=distance)
        one.assessed(failed(), 0.0)
        for _ in range(3):
            one.search(FRAME, POSE)
        assert finder.near == [True, False, False] and finder.distances == [distance] * 3
    for wrong in ((0.8, 0.3), (0.0, 1.0)):
        with pytest.raises(InputError, match="two positive numbers of metres"):
            RecoveryConfig(distance=wrong)


def test_a_lost_object_has_no_pose_but_a_reason() -> None:
    one = supervisor(Finder(1, 1))
    wrong = TrackingResult(POSE, 3, StopReason.STOP_ACTION, 0.1, 5.0)
    result = one.assessed(wrong, 0.0)
    assert result.pose is None and result.state is TrackingState.LOST and result.error
    # Without a detector it is only said.
    kept = Supervisor(None, RecoveryConfig(states=StateConfig(frames_to_lose=1)), True)
    result = kept.assessed(wrong, 0.0)
    assert result.pose is POSE and result.state is TrackingState.LOST and not kept.lost


def failed() -> TrackingResult:
    return TrackingResult(None, 0, StopReason.FAILED, 0.0, 1.0, "out of sight")


@pytest.fixture(scope="module")
def policy() -> Any:
    return load_policy()


def test_gone_and_back(scene: Any, policy: Any) -> None:
    soon = TrackerConfig(recovery=RecoveryConfig(interval=2))
    tracker = PoseTracker(scene.mesh, scene.camera, scene.pose(0), policy=policy, config=soon)
    other = np.random.default_rng(0).integers(0, 255, (12, 16, 3), np.uint8)
    other = other.repeat(10, 0).repeat(10, 1)
    images = [scene.image(0), scene.image(1), other, other, other, other, scene.image(4)]
    results = [tracker.update(image) for image in [*images, scene.image(5), scene.image(6)]]
    states = [str(one.state) for one in results]
    assert states[:2] == ["tracking"] * 2 and states[4:6] == ["lost"] * 2
    assert results[5].pose is None and "lost" in (results[5].error or "")
    assert states[-1] == "tracking" and results[-1].pose is not None
    error = (results[-1].pose.translation - scene.pose(6).translation).norm()
    assert float(error) < 0.05 * scene.mesh.diameter


def test_without_a_start_the_object_is_looked_for(scene: Any, policy: Any) -> None:
    tracker = PoseTracker(scene.mesh, scene.camera, policy=policy)
    result = tracker.update(scene.image(0))
    assert result.state is TrackingState.TRACKING and result.pose is not None
    assert float((result.pose.translation - scene.pose(0).translation).norm()) < 0.01


def test_who_cannot_look_needs_a_start(scene: Any, policy: Any) -> None:
    oracle = OraclePolicy(Pose.identity(1))
    for options in (
        {"policy": oracle},
        {"policy": policy, "config": TrackerConfig(recovery=RecoveryConfig(False))},
    ):
        with pytest.raises(InputError, match="give a start pose"):
            PoseTracker(scene.mesh, scene.camera, **options)


def test_two_objects_have_states_of_their_own(
    scene: Any, policy: Any, make_sequence: Callable[..., Any]
) -> None:
    away = Pose(scene.pose(0).rotation, torch.tensor([0.09, 0.07, 0.6], dtype=torch.float64))
    config = TrackerConfig(
        recovery=RecoveryConfig(False, states=StateConfig(frames_to_lose=1)),
        multi_start=MultiStartConfig(enabled=False),
    )
    tracker = PoseTracker(
        [scene.mesh, scene.mesh], scene.camera, [scene.pose(0), away], policy=policy,
        config=config,
    )  # fmt: skip
    one, other = tracker.update(scene.image(0))
    assert one.state is TrackingState.TRACKING
    assert other.state is not TrackingState.TRACKING


def test_a_search_that_raised_is_begun_again() -> None:
    class Broken(Finder):
        def steps(self, frame: Any, region: Any = None, given: Any = (), most: int = 0) -> Steps:
            yield from super().steps(frame, region, given, most)
            if self.searches == 1:
                raise MemoryError
            return found_at(POSE)

    finder = Broken(length=1, finds=99)
    one = supervisor(finder)
    one.assessed(failed(), 0.0)
    with pytest.raises(MemoryError):
        one.search(FRAME, POSE)
    assert one.search(FRAME, POSE) is not None and finder.near == [True, True]


def test_only_with_a_time_limit_a_search_keeps_a_copy_of_the_image() -> None:
    for limit, same in ((None, True), (0.0, False)):
        finder = Finder(length=3, finds=1)
        one = supervisor(finder, max_milliseconds=limit)
        one.assessed(failed(), 0.0)
        one.search(FRAME, POSE)
        seen = finder.frames[0].pixels
        assert (seen.data_ptr() == FRAME.pixels.data_ptr()) is same
        assert torch.equal(seen, FRAME.pixels)


class Elsewhere(Finder):
    """Finds the object where others are, unless it is told so when it begins."""

    def is_taken(self, centred: Pose, taken: Sequence[Pose]) -> bool:
        return any(torch.allclose(MESH.outer(centred).matrix, other.matrix) for other in taken)


@pytest.mark.usefixtures("stays")
def test_who_was_found_by_another_search_in_the_meantime_is_not_found_again() -> None:
    finder = Elsewhere(length=2, finds=1)
    one = supervisor(finder, max_milliseconds=0.0)
    one.assessed(failed(), 0.0)
    assert [one.search(FRAME, POSE) for _ in range(2)] == [None, None] and one.searching
    assert one.search(FRAME, POSE, [POSE]) is None and one.lost and not one.searching
    # The next search, of the whole image, knows of it from the beginning.
    one.search(FRAME, POSE, [POSE])
    assert finder.near == [True, False] and finder.taken == [(), (POSE,)]


def test_a_lost_instance_is_not_looked_for_where_another_is_followed(
    scene: Any, policy: Any
) -> None:
    away = Pose(scene.pose(0).rotation, torch.tensor([0.09, 0.07, 0.6], dtype=torch.float64))
    other = replace(scene.mesh, vertices=scene.mesh.vertices * 1.1)
    meshes = [scene.mesh, replace(scene.mesh, name="second"), other]
    tracker = PoseTracker(
        meshes, scene.camera, [scene.pose(0), away, away], policy=policy, config=LOOP_ONLY
    )
    taken: list[tuple[Pose, ...]] = []
    for supervisor in tracker.supervisors[1:]:
        finder = Finder(length=1, finds=99)
        supervisor.detector, finder.taken = finder, taken  # type: ignore[assignment]
        supervisor.tell("lost")
    tracker.update(scene.image(0))
    (where,), none = taken
    torch.testing.assert_close(where.matrix, scene.pose(0).matrix)
    assert none == ()


@pytest.mark.usefixtures("stays")
def test_a_time_limit_leaves_no_frame_without_a_search() -> None:
    finder = Finder(length=2, finds=3)
    one = supervisor(finder, max_milliseconds=0.0, interval=10)
    one.assessed(failed(), 0.0)
    found = [one.search(FRAME, POSE) is not None for _ in range(9)]
    assert finder.searches == 3 and found == [False] * 8 + [True]


def test_a_lost_object_costs_few_searches() -> None:
    finder = Finder(length=5, finds=99)
    one = supervisor(finder)
    one.assessed(failed(), 0.0)
    begun = []
    for _ in range(45):
        before = finder.searches
        one.search(FRAME, POSE)
        begun.append(finder.searches > before)
    # Soon at first, then at twice the interval each time, up to the largest.
    assert [k for k, new in enumerate(begun) if new] == [0, 2, 6, 14, 24, 34, 44]
    assert finder.near == [True] + 6 * [False]


@pytest.mark.parametrize("coloured", [True, False])
def test_the_probability_that_the_states_go_by_is_given_out(brick: Any, coloured: bool) -> None:
    mesh = brick if coloured else Mesh.from_arrays("plain", brick.vertices, brick.faces)
    assert mesh.has_colours is coloured
    one = Supervisor(None, RecoveryConfig(), True, coloured=mesh.has_colours)
    result = TrackingResult(POSE, 3, StopReason.STOP_ACTION, 0.72, 5.0)
    told = one.assessed(result, 0.4)
    assert told.confidence == 0.72
    assert told.probability == probability_of(StateConfig(), 0.72, 0.4, coloured)
    assert told.state is (TrackingState.TRACKING if coloured else TrackingState.UNCERTAIN)
    assert one.assessed(failed(), 0.4).probability is None


def test_a_mesh_is_looked_at_once(scene: Any, policy: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    looked: list[bool] = []
    has_colours = Mesh.has_colours.fget
    assert has_colours is not None

    def counted(mesh: Mesh) -> bool:
        looked.append(True)
        return bool(has_colours(mesh))

    monkeypatch.setattr(Mesh, "has_colours", property(counted))
    plain = Mesh.from_arrays("plain", scene.mesh.vertices + scene.mesh.center, scene.mesh.faces)
    config = TrackerConfig(recovery=RecoveryConfig(False))
    tracker = PoseTracker(plain, scene.camera, scene.pose(0), policy=policy, config=config)
    for _ in range(3):
        tracker.update(scene.image(0))
    assert len(looked) == 1 and not tracker.supervisors[0].coloured
