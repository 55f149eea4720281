"""Following a video: every frame gets its row, bad frames too, and the report counts them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import torch

from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.video import VideoFrame
from moveit6d.estimation import PoseTracker, StopReason, TrackingResult
from moveit6d.evaluation import run_tracker as module
from moveit6d.evaluation.metrics import add
from moveit6d.evaluation.run_tracker import TrackedFrame, TrackSummary, run_tracker
from moveit6d.geometry.pose import Pose
from moveit6d.policies import OraclePolicy
from moveit6d.rendering.backends import make_renderer


@pytest.fixture
def tracker(scene: Any) -> PoseTracker:
    """Follows the brick of frame 0 by knowing its pose; starts a little off."""
    true = scene.pose(0)
    start = Pose(true.rotation, true.translation + torch.tensor([0.004, -0.003, 0.01]))
    oracle = OraclePolicy(Pose.stack([scene.mesh.inner(true)]))
    return PoseTracker(scene.mesh, scene.camera, start, policy=oracle, renderer=make_renderer())


def test_good_frames_get_poses(scene: Any, tracker: PoseTracker) -> None:
    image = scene.image(0)
    steps = list(
        run_tracker(tracker, [VideoFrame(5, "a.png", image), VideoFrame(6, "b.png", image)])
    )
    points = torch.from_numpy(scene.mesh.sample_points(100))
    for step, (frame, name) in zip(steps, [(5, "a.png"), (6, "b.png")], strict=True):
        row = step.row
        assert (row.frame, row.image, row.stopped_by) == (frame, name, "stop_action")
        assert row.pose is not None and row.milliseconds is not None and row.milliseconds > 0
        assert float(add(row.pose, scene.pose(0), points)) < 0.003
        assert step.error is None and step.confident
    assert (
        steps[0].row.iterations is not None
        and steps[0].row.iterations > 2
        and steps[1].row.iterations == 1
    )


@pytest.mark.parametrize(
    ("image", "words"),
    [
        (None, "cannot be read"),
        (np.zeros((100, 160, 3), np.uint8), "160×100 but the camera is 160×120"),
        (np.full((120, 160, 3), np.nan), "not finite"),
        (np.zeros((120, 160, 2), np.uint8), "expected shape"),
    ],
)
def test_a_bad_frame_fails_alone(scene: Any, tracker: PoseTracker, image: Any, words: str) -> None:
    good = scene.image(0)
    frames = [
        VideoFrame(0, "a", good),
        VideoFrame(1, "b", image, "b cannot be read." if image is None else None),
        VideoFrame(2, "c", good),
    ]
    steps = list(run_tracker(tracker, frames))
    assert [step.row.pose is None for step in steps] == [False, True, False]
    row = steps[1].row
    assert row == PoseRow(1, "b", stopped_by="failed", state="uncertain"), "it took no time"
    assert steps[1].error is not None and words in steps[1].error


def test_unread_frames_say_nothing_of_the_object(scene: Any, tracker: PoseTracker) -> None:
    good = scene.image(0)
    images = [good, None, None, None, None, good]
    frames = [VideoFrame(k, "", image) for k, image in enumerate(images)]
    steps = list(run_tracker(tracker, frames))
    states = [step.row.state for step in steps]
    assert states == ["tracking", *["uncertain"] * 4, "tracking"]
    assert [step.error for step in steps] == [None, *["no image."] * 4, None]
    assert all(step.row.milliseconds is None for step in steps[1:5])


def test_each_object_has_its_own_state_in_a_frame_that_cannot_be_read(scene: Any) -> None:
    true = scene.pose(0)
    oracle = OraclePolicy(Pose.stack([scene.mesh.inner(true)] * 2))
    meshes = [scene.mesh, scene.mesh]
    both = PoseTracker(meshes, scene.camera, [true, true], policy=oracle, renderer=make_renderer())
    both.supervisors[1].tell("lost")
    (step,) = run_tracker(both, [VideoFrame(7, "g.png", None, "gone")], ["one", "two"])
    (other,) = step.others
    assert [(one.row.object, one.row.state) for one in (step, other)] == [
        ("one", "uncertain"),
        ("two", "lost"),
    ]
    assert step.error == other.error == "gone" and other.row.stopped_by == "failed"


def test_a_lost_object_has_no_pose_even_if_the_tracker_remembers_one() -> None:
    class Lost:
        def update(self, image: Any) -> TrackingResult:
            pose = Pose.identity()
            return TrackingResult(pose, 3, StopReason.FAILED, 0.9, 5.0, "out of sight")

    frame = VideoFrame(0, "a", np.zeros((2, 2, 3), np.uint8))
    (step,) = run_tracker(Lost(), [frame])  # type: ignore[arg-type]
    assert step.row.pose is None and step.error == "out of sight" and not step.confident


def record_of(confidences: list[float | None]) -> TrackSummary:
    record = TrackSummary()
    for frame, confidence in enumerate(confidences):
        pose = None if confidence is None else Pose.identity()
        row = PoseRow(frame, pose=pose, confidence=confidence, milliseconds=float(frame))
        error = "bad image" if confidence is None else None
        record.add(TrackedFrame(VideoFrame(frame, "", None), row, error))
    return record


def test_the_report_counts_frames_failures_and_time() -> None:
    facts = record_of([0.9, None, 0.8, 0.1]).facts()
    assert facts["frames"] == 4 and facts["failed"] == 1
    assert facts["failures"] == [{"frame": 1, "error": "bad image"}]
    assert facts["mean_milliseconds"] == facts["median_milliseconds"] == 1.5
    assert facts["lost_from_frame"] is None


def test_nothing_tracked_has_no_times() -> None:
    assert TrackSummary().facts()["median_milliseconds"] is None


def test_fifteen_frames_of_low_confidence_are_taken_for_lost() -> None:
    assert record_of([0.9] * 3 + [0.2] * 14 + [0.9]).lost_from is None
    assert record_of([0.9] * 3 + [0.2] * 7 + [None] * 8).lost_from == 3
    assert record_of([0.9] * 3 + [0.2] * 30).lost_from == 3


def told(states: list[str], errors: list[str | None]) -> dict[str, Any]:
    record = TrackSummary()
    for number, (state, error) in enumerate(zip(states, errors, strict=True)):
        row = PoseRow(number, pose=None if error else Pose.identity(), state=state)
        record.add(TrackedFrame(VideoFrame(number, "", None), row, error))
    return record.facts()


def test_the_summary_says_when_the_object_was_lost_as_its_events_do() -> None:
    states = ["tracking"] * 2 + ["uncertain"] * 20 + ["lost"] * 3 + ["tracking", "lost"]
    lost = "The object is lost."
    facts = told(states, [None] * 22 + ["out of sight", lost, lost, None, lost])
    first = next(event["first"] for event in facts["events"] if event["state"] == "lost")
    assert facts["lost_from_frame"] == first == 22
    assert facts["failures"] == [{"frame": 22, "error": "out of sight"}], "the events say the rest"
    assert facts["failed"] == 4
    assert told(["uncertain"] * 30, [None] * 30)["lost_from_frame"] is None


def test_failures_of_a_lost_object_leave_room_for_others() -> None:
    lost: list[str | None] = ["The object is lost."] * 150
    facts = told(["lost"] * 151, [*lost, "7.png is damaged."])
    assert facts["failures"] == [{"frame": 150, "error": "7.png is damaged."}]


def test_the_probability_of_a_result_is_in_its_row() -> None:
    class Tracks:
        def update(self, image: Any) -> TrackingResult:
            reason = StopReason.STOP_ACTION
            return TrackingResult(Pose.identity(), 3, reason, 0.9, 5.0, state_probability=0.7)

    frame = VideoFrame(0, "a", np.zeros((2, 2, 3), np.uint8))
    (step,) = run_tracker(Tracks(), [frame])  # type: ignore[arg-type]
    assert (step.row.confidence, step.row.probability) == (0.9, 0.7)


def test_only_so_many_failures_are_described() -> None:
    record = record_of([None] * 150)
    assert record.failed == 150 and len(record.failures) == 100


def test_a_video_without_an_end_takes_no_more_memory(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "KEPT_TIMES", 500)
    monkeypatch.setattr(module, "KEPT_EVENTS", 10)
    record = TrackSummary()
    for frame in range(5000):
        state = "tracking" if frame % 2 else "uncertain"
        record.add_row(PoseRow(frame, milliseconds=float(frame), state=state))
    assert len(record.milliseconds) == 500 and len(record.events) == 10
    assert record.events[-1] == {"state": "tracking", "first": 4999, "last": 4999}
    facts = record.facts()
    assert facts["mean_milliseconds"] == 2499.5 and facts["states"] == {
        "uncertain": 2500,
        "tracking": 2500,
    }
    assert abs(facts["median_milliseconds"] - 2499.5) < 300  # type: ignore[operator]
