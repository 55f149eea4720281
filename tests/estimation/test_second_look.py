"""Second looks: when they are made, what they must bring, and a wrong pose that they correct."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import pytest
import torch

from moveit6d import InputError, Pose, PoseDetector, PoseTracker, load_policy
from moveit6d.config import MultiStartConfig, RecoveryConfig, SecondLookConfig, TrackerConfig
from moveit6d.estimation import StopReason, TrackingResult
from moveit6d.estimation.detection import Detection, Evidence, FoundPose
from moveit6d.estimation.detection.steps import Steps
from moveit6d.estimation.results import Refined, Start
from moveit6d.estimation.second_look import SecondLook
from moveit6d.frame import Frame, prepare_frame
from moveit6d.geometry.rotation import exp_so3


@pytest.fixture(scope="module")
def policy() -> Any:
    return load_policy()


class Searches:
    """Stands in for `PoseDetector.steps`: searches of some steps that find what they are told."""

    def __init__(self, found: Pose | None, length: int = 0) -> None:
        self.found, self.length, self.count = found, length, 0
        self.taken: list[tuple[Pose, ...]] = []
        self.frames: list[Frame] = []

    def __call__(self, frame: Any, region: Any, most: int) -> Steps:
        assert region.near is not None and most == 16
        self.count += 1
        self.taken.append(region.taken)
        self.frames.append(frame)
        for _ in range(self.length):
            yield
        if self.found is None:
            return Detection(())
        result = TrackingResult(self.found, 1, StopReason.MAX_ITERATIONS, 0.9, 1.0)
        return Detection((FoundPose(result, Evidence(0.9, 0.9)),))


def a_look(scene: Any, policy: Any, searches: Searches, **options: Any) -> SecondLook:
    config = RecoveryConfig(**options)
    look = SecondLook(PoseDetector(scene.mesh, scene.camera, policy=policy), config)
    look.detector.steps = searches  # type: ignore[assignment,method-assign]
    return look


def begun(
    look: SecondLook, searches: Searches, scene: Any, confidences: Sequence[float]
) -> list[int]:
    """Frames in which a search began, with these confidences of the pose followed."""
    frame = prepare_frame(scene.image(0), scene.camera)
    start = Start(frame, scene.mesh, scene.mesh.inner(scene.pose(0)))
    found = []
    for number, confidence in enumerate(confidences):
        before = searches.count
        look.better(start, confidence)
        if searches.count > before:
            found.append(number)
    return found


def test_only_a_pose_in_doubt_is_looked_at_again_and_not_in_every_frame(
    scene: Any, policy: Any
) -> None:
    searches = Searches(None)
    look = a_look(scene, policy, searches)
    assert begun(look, searches, scene, [0.9, 0.85, 0.7] + 21 * [0.5] + [0.9]) == [2, 12, 22]


def test_an_object_that_was_found_is_looked_at_again_however_confident(
    scene: Any, policy: Any
) -> None:
    searches = Searches(None)
    look = a_look(scene, policy, searches)
    look.was_found()
    assert begun(look, searches, scene, 40 * [0.99]) == [4, 9, 14]


def test_never_where_the_settings_say_so(scene: Any, policy: Any) -> None:
    searches = Searches(None)
    never = SecondLookConfig(below=0.0, after_found=0)
    look = a_look(scene, policy, searches, second_look=never)
    look.was_found()
    assert begun(look, searches, scene, 20 * [0.1]) == []


def test_a_search_may_take_several_frames(scene: Any, policy: Any) -> None:
    searches = Searches(scene.pose(0), length=3)
    look = a_look(scene, policy, searches, max_milliseconds=0.0)
    frame = prepare_frame(scene.image(0), scene.camera)
    start = Start(frame, scene.mesh, scene.mesh.inner(scene.pose(0)))
    answers = [look.better(start, 0.1) is not None for _ in range(6)]
    # Three frames, and one more to come from the first of them to the present one.
    assert answers == [False, False, False, False, True, False] and searches.count == 1


def test_a_search_that_raised_is_begun_again(scene: Any, policy: Any) -> None:
    class Broken(Searches):
        def __call__(self, frame: Any, region: Any, most: int) -> Steps:
            yield from super().__call__(frame, region, most)
            raise MemoryError

    searches = Broken(None)
    look = a_look(scene, policy, searches)
    frame = prepare_frame(scene.image(0), scene.camera)
    start = Start(frame, scene.mesh, scene.mesh.inner(scene.pose(0)))
    raised = 0
    for _ in range(12):
        try:
            look.better(start, 0.1)
        except MemoryError:
            raised += 1
    assert searches.count == raised == 2


def test_only_with_a_time_limit_a_search_keeps_a_copy_of_the_image(scene: Any, policy: Any) -> None:
    for limit, same in ((None, True), (0.0, False)):
        searches = Searches(None, length=3)
        look = a_look(scene, policy, searches, max_milliseconds=limit)
        frame = prepare_frame(scene.image(0), scene.camera)
        look.better(Start(frame, scene.mesh, scene.mesh.inner(scene.pose(0))), 0.1)
        seen = searches.frames[0].pixels
        assert (seen.data_ptr() == frame.pixels.data_ptr()) is same
        assert torch.equal(seen, frame.pixels)


def test_a_second_look_knows_its_objects_number(
    scene: Any, policy: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[Any] = []

    def refined(starts: Any, *, targets: Any, **_: Any) -> list[Refined]:
        asked.append(targets)
        return [Refined(None, 0, StopReason.FAILED, 0.0, 1.0)]

    monkeypatch.setattr("moveit6d.estimation.second_look.refine_starts", refined)
    look = SecondLook(
        PoseDetector(scene.mesh, scene.camera, policy=policy), RecoveryConfig(), target=4
    )
    look.detector.steps = Searches(scene.pose(0))  # type: ignore[assignment,method-assign]
    frame = prepare_frame(scene.image(0), scene.camera)
    look.better(Start(frame, scene.mesh, scene.mesh.inner(scene.pose(0))), 0.1)
    assert asked == [[4]]


def test_another_instance_is_not_a_better_pose(scene: Any, policy: Any) -> None:
    searches = Searches(scene.pose(0))
    frame = prepare_frame(scene.image(0), scene.camera)
    start = Start(frame, scene.mesh, scene.mesh.inner(scene.pose(1)))
    assert a_look(scene, policy, searches).better(start, 0.1) is not None
    assert a_look(scene, policy, searches).better(start, 0.1, [scene.pose(0)]) is None
    assert [len(taken) for taken in searches.taken] == [0, 1]


def test_another_pose_must_be_much_likelier(scene: Any, policy: Any) -> None:
    """The truth is found each time; the pose followed is the less sure the lower."""
    searches = Searches(scene.pose(0))
    frame = prepare_frame(scene.image(0), scene.camera)
    start = Start(frame, scene.mesh, scene.mesh.inner(scene.pose(0)))
    found = a_look(scene, policy, searches).better(start, 0.3)
    assert found is not None and found.confidence > 0.8
    config = SecondLookConfig(below=1.0, evidence=0.4)
    odds = found.confidence / (1 - found.confidence)
    for known, expected in ((odds / 1.3, False), (odds / 1.7, True)):
        look = a_look(scene, policy, searches, second_look=config)
        assert (look.better(start, known / (1 + known)) is not None) is expected


def test_a_track_that_is_turned_by_far_comes_right(scene: Any, policy: Any) -> None:
    turn = exp_so3(torch.tensor([0.0, 1.3, 0.0], dtype=torch.float64))
    wrong = Pose(turn @ scene.pose(0).rotation, scene.pose(0).translation)

    def error(second_look: SecondLookConfig) -> float:
        """Degrees after six frames."""
        config = TrackerConfig(
            recovery=RecoveryConfig(second_look=second_look),
            multi_start=MultiStartConfig(enabled=False),
        )
        tracker = PoseTracker(scene.mesh, scene.camera, wrong, policy=policy, config=config)
        for number in range(6):
            result = tracker.update(scene.image(number))
            if result.pose is None:
                return 180.0
        between = result.pose.rotation.mT @ scene.pose(5).rotation
        cosine = ((between.trace() - 1) / 2).clamp(-1, 1)
        return float(torch.rad2deg(torch.arccos(cosine)))

    assert error(SecondLookConfig()) < 5
    assert error(SecondLookConfig(below=0.0)) > 20


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"below": 1.5}, "below must be from 0 to 1"),
        ({"after_found": -1}, "after_found 0 or more"),
        ({"evidence": -0.1}, "evidence and found_evidence must be 0 or more"),
        ({"interval": 0}, "interval and places must be 1 or more"),
        ({"stages": ()}, "stages must be one or more pairs"),
    ],
)
def test_settings_that_make_no_sense_are_refused(options: dict[str, Any], words: str) -> None:
    with pytest.raises(InputError, match=words):
        SecondLookConfig(**options)
