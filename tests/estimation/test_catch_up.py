"""From where a search found an object to where it is now, through the frames in between."""

from __future__ import annotations

from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import pytest
import torch

from moveit6d import Pose, load_policy, make_renderer
from moveit6d.config import RecoveryConfig, TrackerConfig
from moveit6d.estimation import StopReason, TrackingResult, catch_up
from moveit6d.estimation.catch_up import CatchUp
from moveit6d.estimation.detection import Detection, FoundPose
from moveit6d.estimation.detection.steps import Steps, within
from moveit6d.estimation.results import Refined, Start
from moveit6d.frame import prepare_frame


def a_search(pose: Pose | None) -> Steps:
    """It ends in its second step."""
    yield
    result = TrackingResult(pose, 1, StopReason.MAX_ITERATIONS, 0.9, 1.0)
    return Detection((FoundPose(result),) if pose is not None else ())


def a_detector(scene: Any) -> Any:
    return SimpleNamespace(
        mesh=scene.mesh, settings=TrackerConfig(), policy=load_policy(), renderer=make_renderer()
    )


def begun(scene: Any, pose: Pose | None, **options: Any) -> CatchUp:
    one = CatchUp(a_detector(scene), a_search(pose), RecoveryConfig(**options))
    assert within(one.steps, 0.0) is None
    return one


def test_what_was_found_in_an_earlier_frame_is_followed_to_the_present_one(scene: Any) -> None:
    one = begun(scene, scene.pose(0))
    image = scene.image(1)
    for number in range(4, 29, 4):
        image[:] = scene.image(number)  # a caller who has one picture for all frames
        one.add(prepare_frame(image, scene.camera))
    ended = within(one.steps, None)
    assert ended is not None and ended.found is not None
    off = (ended.found.translation - scene.pose(28).translation).norm()
    assert (
        float(off) < 0.02 < float((scene.pose(0).translation - scene.pose(28).translation).norm())
    )


def test_a_search_that_ends_in_its_frame_is_its_answer(scene: Any) -> None:
    pose = scene.pose(0)
    ended = within(begun(scene, pose).steps, None)
    assert ended is not None and ended.found is pose


def test_who_was_not_found_is_not_followed(scene: Any) -> None:
    one = begun(scene, None)
    one.add(prepare_frame(scene.image(1), scene.camera))
    ended = within(one.steps, 0.0)
    assert ended is not None and ended.found is None


@pytest.mark.parametrize(("kept", "stride"), [(24, 1), (4, 1), (5, 2), (1, 3)])
def test_of_many_frames_some_are_kept_and_the_newest_is_the_last(
    scene: Any, kept: int, stride: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []

    def refined(starts: Sequence[Start], **_: Any) -> list[Refined]:
        seen.append(int(starts[0].frame.pixels[0, 0, 0]))
        return [Refined(starts[0].centred, 1, StopReason.MAX_ITERATIONS, 0.9, 1.0)]

    monkeypatch.setattr(catch_up, "refine_starts", refined)
    one = begun(scene, scene.pose(0), frames_kept=kept, stride=stride)
    for number in range(1, 20):
        frame = prepare_frame(scene.image(0), scene.camera).copy()
        one.add(type(frame)(torch.full_like(frame.pixels, number), frame.camera))
    assert within(one.steps, None) is not None
    assert seen == sorted(seen) and seen[-1] == 19 and len(seen) <= -(-kept // stride)
    assert len(seen) > 0.4 * min(kept, 19) // stride
