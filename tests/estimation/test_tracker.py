"""The tracker and the estimator: several objects, bad frames, wrong images."""

import dataclasses
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from moveit6d.actions import PoseAction, pose_delta
from moveit6d.config import ActionMode, KeyframeConfig, RecoveryConfig, TrackerConfig
from moveit6d.contour import ColourHistograms, refine_contour
from moveit6d.errors import InputError
from moveit6d.estimation import PoseTracker, StopReason
from moveit6d.estimation.detection import TemplateStore
from moveit6d.estimation.half_turns import HalfTurnCheck
from moveit6d.estimation.keyframes import KeyframeMemory
from moveit6d.estimation.results import Refined, Start
from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.rotation import exp_so3, log_so3
from moveit6d.geometry.symmetry import ContinuousSymmetry, Symmetries
from moveit6d.networks.policy_output import PolicyOutput
from moveit6d.observation import Observation
from moveit6d.policies import LoopState, OraclePolicy, load_policy
from moveit6d.rendering.backends import make_renderer
from tests.support import pictures
from tests.support.configs import ALWAYS_CONTOUR, LOOP_ONLY, LOW_CONFIDENCE, NO_CONTOUR
from tests.support.meshes import box_arrays
from tests.support.near_sighted import NearSighted, Numbered

CAMERA = Camera(300, 300, 159.5, 119.5, 320, 240)
GRAY = np.full((240, 320, 3), 90, np.uint8)


def at(x: float, z: float = 0.7) -> Pose:
    return Pose(torch.eye(3).double(), torch.tensor([x, 0.0, z], dtype=torch.float64))


def test_every_frame_starts_where_the_last_one_ended(brick: Mesh) -> None:
    tracker = PoseTracker(
        brick, CAMERA, at(0.0), policy=OraclePolicy(Pose.stack([brick.inner(at(0.01))]))
    )
    first = tracker.update(GRAY)
    second = tracker.update(GRAY)
    assert first.iterations > 3 and second.iterations == 1
    assert first.pose is not None and second.pose is not None
    torch.testing.assert_close(second.pose.matrix, first.pose.matrix)


def test_several_objects_in_one_batch(brick: Mesh) -> None:
    goals = [at(-0.05), at(0.02, 0.9), at(0.06, 0.6)]
    policy = OraclePolicy(Pose.stack([brick.inner(goal) for goal in goals]), ActionMode.ALL_AXES)
    tracker = PoseTracker([brick] * 3, CAMERA, [at(0.0), at(0.0), at(0.0)], policy=policy)
    for result, goal in zip(tracker.update(GRAY), goals, strict=True):
        assert result.pose is not None
        diameter = torch.tensor(brick.sphere_diameter, dtype=torch.float64)
        assert pose_delta(brick.inner(result.pose), brick.inner(goal), diameter).abs().max() < 0.5


def test_an_object_in_doubt_is_looked_for_around_where_it_was_sure(brick: Mesh) -> None:
    jump = at(0.047)  # 28 units: farther than this policy sees
    policy = NearSighted(brick.inner(at(0.0)), 21.0, doubt=0.3)
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy, config=NO_CONTOUR)
    assert tracker.update(GRAY).confidence == pytest.approx(0.95)
    policy.truth = brick.inner(jump)
    found = tracker.update(GRAY)
    assert found.pose is not None and found.confidence == pytest.approx(0.95)
    torch.testing.assert_close(found.pose.matrix, jump.matrix)


def test_what_is_found_elsewhere_but_in_doubt_is_left_there(brick: Mesh) -> None:
    @dataclasses.dataclass
    class Wary(NearSighted):
        """Has a low confidence, even where the object is."""

        def predict(self, seen: Observation, state: LoopState) -> PolicyOutput:
            prediction = super().predict(seen, state)
            return dataclasses.replace(
                prediction, confidence=prediction.confidence.clamp(max=LOW_CONFIDENCE - 0.01)
            )

    policy = Wary(brick.inner(at(0.039)), 21.0, doubt=0.3)
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy, config=NO_CONTOUR)
    result = tracker.update(GRAY)
    assert result.pose is not None and result.confidence == pytest.approx(0.3)
    torch.testing.assert_close(result.pose.matrix, at(0.0).matrix)
    assert policy.asked > result.iterations, "it did look"


def test_a_way_that_leads_through_the_camera_ends_no_track(brick: Mesh) -> None:
    policy = NearSighted(brick.inner(at(0.0, 0.6)), 60.0, doubt=0.3)
    tracker = PoseTracker(brick, CAMERA, at(0.0, 0.6), policy=policy, config=NO_CONTOUR)
    for z in (0.6, 0.5, 0.4):
        policy.truth = brick.inner(at(0.0, z))
        assert tracker.update(GRAY).confidence > LOW_CONFIDENCE
    policy.reach = 0.0
    for _ in range(9):
        result = tracker.update(GRAY)
        assert result.pose is not None and result.confidence == pytest.approx(0.3)
    assert any(float(pose.translation[2]) < 0 for pose in tracker.tracks[0].recovery_poses()), (
        "or the test says nothing"
    )


def test_a_confident_frame_has_no_recovery_starts(brick: Mesh) -> None:
    policy = NearSighted(brick.inner(at(0.01)), 0.0, doubt=LOW_CONFIDENCE + 0.01)
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy, config=NO_CONTOUR)
    assert tracker.update(GRAY).iterations == policy.asked


def test_each_frame_looks_at_other_places_and_the_papers_policy_at_none(brick: Mesh) -> None:
    for mode in ActionMode:
        policy = NearSighted(brick.inner(at(0.0)), 0.0, doubt=0.3, mode=mode)
        tracker = PoseTracker(brick, CAMERA, at(0.01), policy=policy, config=NO_CONTOUR)
        before = tracker.tracks[0].random.bit_generator.state["state"]
        result = tracker.update(GRAY)
        after = tracker.tracks[0].random.bit_generator.state["state"]
        looked = mode is ActionMode.ALL_AXES
        assert (policy.asked > result.iterations) == looked == (before != after)


def test_without_search_it_never_costs_more_than_the_loop(brick: Mesh) -> None:
    policy = NearSighted(brick.inner(at(0.047)), 21.0, doubt=0.3)
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy, config=LOOP_ONLY)
    for _ in range(3):
        policy.asked = 0
        result = tracker.update(GRAY)
        assert result.confidence == pytest.approx(0.3) and policy.asked == result.iterations


def test_an_object_that_is_not_found_stays_where_it_was_last(brick: Mesh) -> None:
    policy = NearSighted(brick.inner(at(0.0)), 0.0, doubt=0.3)
    tracker = PoseTracker(brick, CAMERA, at(0.01), policy=policy, config=LOOP_ONLY)
    for _ in range(2):
        result = tracker.update(GRAY)
        assert result.pose is not None
        torch.testing.assert_close(result.pose.matrix, at(0.01).matrix)


def test_a_track_is_the_same_after_a_reset_to_its_start(brick: Mesh) -> None:
    policy = NearSighted(brick.inner(at(0.047)), 21.0, doubt=0.3)
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy, config=NO_CONTOUR)
    first = [tracker.update(GRAY).pose for _ in range(3)]
    tracker.reset(at(0.0))
    for before in first:
        again = tracker.update(GRAY).pose
        assert before is not None and again is not None
        torch.testing.assert_close(before.matrix, again.matrix, rtol=0, atol=0)


BAD = [
    (np.full((240, 320, 3), np.nan), "not finite"),
    (np.zeros((240, 320, 2), np.uint8), "shape"),
    (np.zeros((240, 320, 3), np.uint16), "uint16"),
    (np.zeros((480, 640, 3), np.uint8), "640×480"),
    (np.full((240, 320, 3), 200.0), r"\[0, 1\]"),
    (np.zeros((240, 320, 3), np.int64), "uint8"),
    ("picture.png", "array"),
]


@pytest.mark.parametrize(("image", "message"), BAD)
def test_a_bad_frame_never_ends_a_track(brick: Mesh, image: object, message: str) -> None:
    policy = OraclePolicy(Pose.stack([brick.inner(at(0.004))]))
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy)
    failed = tracker.update(image)
    assert failed.stopped_by is StopReason.FAILED and failed.pose is None
    assert failed.error is not None
    assert tracker.update(GRAY).pose is not None


def test_each_object_needs_its_start(brick: Mesh) -> None:
    with pytest.raises(InputError, match="2 meshes need"):
        PoseTracker([brick, brick], CAMERA, [at(0.0)], policy=OraclePolicy(Pose.stack([at(0.0)])))


def test_a_reset_starts_the_next_frame_from_the_given_pose(brick: Mesh) -> None:
    policy = OraclePolicy(Pose.stack([brick.inner(at(0.01))]))
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy)
    far = tracker.update(GRAY).iterations
    tracker.reset(at(0.01))
    assert tracker.update(GRAY).iterations == 1
    tracker.reset([at(0.0)])
    assert tracker.update(GRAY).iterations == far > 3


def test_a_reset_to_a_pose_out_of_sight_changes_nothing(brick: Mesh) -> None:
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=OraclePolicy(Pose.stack([at(0.0)])))
    for poses, message in ((at(5.0), "outside"), ([at(0.0), at(0.0)], "1 meshes need")):
        with pytest.raises(InputError, match=message):
            tracker.reset(poses)
        torch.testing.assert_close(tracker.poses[0].matrix, at(0.0).matrix)


def test_the_contour_is_refined_after_the_policy(brick: Mesh) -> None:
    """The policy is wrong by two units of shift and of size; the picture shows it."""
    diameter = torch.tensor(brick.sphere_diameter, dtype=torch.float64)
    truth = Pose(torch.eye(3).double(), torch.tensor([0.02, -0.01, 0.5], dtype=torch.float64))
    wrong = PoseAction.from_delta(torch.tensor([2.0, 0, 2.0, 0, 0, 0])).apply_centred(
        truth, diameter
    )
    frame = pictures.picture(brick, truth).permute(1, 2, 0).numpy()
    far = []
    for contour in (True, False):
        policy = OraclePolicy(Pose.stack([wrong]), ActionMode.ALL_AXES)
        tracker = PoseTracker(
            brick,
            pictures.CAMERA,
            brick.outer(truth),
            policy=policy,
            config=ALWAYS_CONTOUR if contour else NO_CONTOUR,
        )
        result = tracker.update(frame)
        assert result.pose is not None
        torch.testing.assert_close(result.pose.matrix, tracker.poses[0].matrix)
        far.append(pose_delta(truth, brick.inner(result.pose), diameter).norm())
        assert (tracker.tracks[0].histograms is not None) == contour
    assert far[0] < 0.8 * far[1]
    assert far[1] == pytest.approx(8**0.5, abs=0.1)


def test_a_reset_forgets_the_colours(brick: Mesh) -> None:
    truth = Pose(torch.eye(3).double(), torch.tensor([0.02, -0.01, 0.5], dtype=torch.float64))
    tracker = PoseTracker(
        brick, pictures.CAMERA, brick.outer(truth), policy=OraclePolicy(Pose.stack([truth]))
    )
    tracker.update(pictures.picture(brick, truth).permute(1, 2, 0).numpy())
    assert tracker.tracks[0].histograms is not None
    tracker.reset(brick.outer(truth))
    assert tracker.tracks[0].histograms is None


def test_colours_are_learnt_from_a_frame_whose_pose_is_exact(brick: Mesh) -> None:
    truth = Pose(torch.eye(3).double(), torch.tensor([0.02, -0.01, 0.5], dtype=torch.float64))
    tracker = PoseTracker(
        brick, pictures.CAMERA, brick.outer(truth), policy=OraclePolicy(Pose.stack([truth]))
    )
    picture = pictures.picture(brick, truth)
    tracker.calibrate(picture.permute(1, 2, 0).numpy())
    learnt = tracker.tracks[0].histograms
    own = histograms_at_truth(brick, truth, picture)
    assert learnt is not None
    np.testing.assert_allclose(learnt.inside, own.inside)
    np.testing.assert_allclose(learnt.outside, own.outside)
    darker = (0.6 * picture).to(torch.uint8)
    tracker.update(darker.permute(1, 2, 0).numpy())
    after = tracker.tracks[0].histograms
    assert after is not None and not np.allclose(after.inside, learnt.inside)  # and goes on


def histograms_at_truth(mesh: Mesh, truth: Pose, picture: torch.Tensor) -> ColourHistograms:
    """As the refinement gives them at a pose that it leaves where it is."""
    refined = refine_contour(
        picture,
        pictures.CAMERA.matrix,
        mesh,
        truth,
        make_renderer(),
        histograms=ColourHistograms(*[np.full(32**3, 32.0**-3, np.float32)] * 2),
    )
    assert refined.histograms is not None
    return refined.histograms


def test_a_picture_to_learn_from_must_fit_the_camera(brick: Mesh) -> None:
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=OraclePolicy(Pose.stack([at(0.0)])))
    with pytest.raises(InputError, match="640×480"):
        tracker.calibrate(np.zeros((480, 640, 3), np.uint8))


def test_an_object_of_revolution_does_not_spin(brick: Mesh) -> None:
    axis = ContinuousSymmetry(np.array([0.0, 0.0, 1.0]), brick.center)
    can = dataclasses.replace(brick, symmetries=Symmetries(continuous=(axis,)))
    turned = Pose(
        exp_so3(torch.tensor([0.02, 0.0, 0.5]).double()),
        torch.tensor([0.01, 0.0, 0.7], dtype=torch.float64),
    )
    policy = OraclePolicy(Pose.stack([turned]), ActionMode.ALL_AXES)
    tracker = PoseTracker(
        can,
        CAMERA,
        can.outer(Pose(torch.eye(3).double(), turned.translation)),
        policy=policy,
        config=NO_CONTOUR,
    )
    result = tracker.update(GRAY)
    assert result.pose is not None
    spin = log_so3(result.pose.rotation)
    assert spin[2].abs() < 1e-2 and spin[0] == pytest.approx(0.02, abs=2e-3)
    torch.testing.assert_close(can.inner(result.pose).translation, turned.translation)


def test_evidence_for_half_turns_ends_with_the_pose_it_is_of(brick: Mesh) -> None:
    never = RecoveryConfig(half_turn_frames=0)
    here = exp_so3(torch.zeros(3, dtype=torch.float64))
    over = exp_so3(torch.tensor([0.0, 0.0, 3.1], dtype=torch.float64))
    for place, turn, kept in ((0.0, here, True), (0.047, here, False), (0.0, over, False)):
        policy = NearSighted(brick.inner(Pose(turn, at(place).translation)), 21.0, doubt=0.3)
        tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy, config=NO_CONTOUR)
        if turn is over:
            policy.reach = 1e3
        check = HalfTurnCheck(never, _evidence=[0.4, 0.0, 0.0])
        tracker.supervisors[0].check = check
        tracker.update(GRAY)
        assert check._evidence == ([0.4, 0.0, 0.0] if kept else [])


def test_what_is_done_to_poses_given_and_taken_does_not_move_a_track(brick: Mesh) -> None:
    start = at(0.0)
    policy = OraclePolicy(Pose.stack([brick.inner(at(0.0))]), ActionMode.ALL_AXES)
    tracker = PoseTracker(brick, CAMERA, start, policy=policy, config=LOOP_ONLY)
    result = tracker.update(GRAY)
    assert result.pose is not None
    for pose in (start, result.pose, tracker.poses[0]):
        pose.rotation.numpy()[1:] *= -1
        pose.translation.numpy()[:] = 9
        torch.testing.assert_close(tracker.poses[0].matrix, at(0.0).matrix)


class Banks(TemplateStore):
    """Prepares nothing, and notes the number of threads it would have."""

    def __init__(self) -> None:
        super().__init__()
        self.threads: list[tuple[int, int]] = []

    def get(self, *arguments: Any) -> Any:
        self.threads.append((torch.get_num_threads(), cv2.getNumThreads()))


def test_meshes_are_prepared_with_the_trackers_threads(brick: Mesh) -> None:
    before, banks = (torch.get_num_threads(), cv2.getNumThreads()), Banks()
    torch.set_num_threads(3)
    cv2.setNumThreads(2)
    try:
        config = TrackerConfig(recovery=RecoveryConfig(max_milliseconds=5.0))
        policy = load_policy()
        tracker = PoseTracker(brick, CAMERA, policy=policy, config=config, store=banks)
        tracker.reset(None)
        assert banks.threads and set(banks.threads) == {(1, 1)}
        assert (torch.get_num_threads(), cv2.getNumThreads()) == (3, 2)
    finally:
        torch.set_num_threads(before[0])
        cv2.setNumThreads(before[1])


class Found:
    """Stands in for a second look: it has found a pose."""

    def __init__(self, centred: Pose) -> None:
        self.centred, self.starts = centred, list[Start]()

    def better(self, start: Start, confidence: float, taken: Sequence[Pose]) -> Refined:
        self.starts.append(start)
        return Refined(self.centred, 1, StopReason.STOP_ACTION, 0.95, 1.0)


def test_a_second_look_at_a_symmetric_object_does_not_turn_it_over(brick: Mesh) -> None:
    turn = np.diag([1.0, -1.0, -1.0, 1.0])
    turn[:3, 3] = brick.center - turn[:3, :3] @ brick.center
    box = dataclasses.replace(brick, symmetries=Symmetries(turn[None]))
    policy = OraclePolicy(Pose.stack([box.inner(at(0.0))]), ActionMode.ALL_AXES)
    tracker = PoseTracker(box, CAMERA, at(0.0), policy=policy, config=LOOP_ONLY)
    over = Pose(torch.from_numpy(turn[:3, :3]), box.inner(at(0.0)).translation)
    tracker.supervisors[0].look = Found(over)  # type: ignore[assignment]
    result = tracker.update(GRAY)
    assert result.pose is not None
    torch.testing.assert_close(result.pose.matrix, at(0.0).matrix, atol=1e-6, rtol=0)


def test_a_second_look_knows_the_keyframes_and_those_of_a_wrong_pose_are_forgotten() -> None:
    vertices, faces, _, _ = box_arrays()
    plain = Mesh.from_arrays("plain", vertices, faces)
    policy = OraclePolicy(Pose.stack([plain.inner(at(0.0))]), ActionMode.ALL_AXES)
    config = dataclasses.replace(LOOP_ONLY, keyframes=KeyframeConfig(enabled=True))
    tracker = PoseTracker(plain, CAMERA, at(0.0), policy=policy, config=config)
    tracker.calibrate(GRAY)
    exact = tracker.tracks[0].keyframes
    assert exact is not None and len(exact.kept) == 1
    tracker.tracks[0].keyframes = exact.add(exact.kept[0])
    look = Found(plain.inner(at(0.0)))
    tracker.supervisors[0].look = look  # type: ignore[assignment]
    tracker.update(GRAY)
    (start,) = look.starts
    assert start.keyframes is not None and len(start.keyframes.kept) == 2
    assert tracker.tracks[0].keyframes is exact


def test_half_turns_are_shown_what_the_pose_is_shown(
    brick: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    starts: list[Start] = []

    def refined(start: Start, **options: Any) -> list[Refined]:
        starts.append(start)
        return [Refined(start.centred, 1, StopReason.STOP_ACTION, 0.1, 1.0)] * 3

    monkeypatch.setattr("moveit6d.estimation.half_turns.refined_half_turns", refined)
    policy = OraclePolicy(Pose.stack([brick.inner(at(0.0))]), ActionMode.ALL_AXES)
    tracker = PoseTracker(brick, CAMERA, at(0.0), policy=policy, config=LOOP_ONLY)
    known = KeyframeMemory(KeyframeConfig())
    tracker.tracks[0].keyframes = known
    tracker.supervisors[0].check = HalfTurnCheck()
    tracker.update(GRAY)
    assert [start.keyframes for start in starts] == [known]


class Describing(Numbered):
    """Has descriptors, so that lost objects are looked for."""

    def descriptors(self, images: torch.Tensor) -> torch.Tensor:
        return torch.zeros(len(images), 8, images.shape[2] // 8, images.shape[3] // 8)


def searched_within(near: float, far: float) -> TrackerConfig:
    return TrackerConfig(recovery=RecoveryConfig(distance=(near, far)))


def test_a_distance_too_far_for_an_object_is_refused_before_the_first_frame(brick: Mesh) -> None:
    policy = Describing(brick.inner(at(0.0)), 21.0)
    widest = 300 * brick.sphere_diameter / 16  # metres, in the image's middle
    for start in (None, at(0.0)):
        PoseTracker(brick, CAMERA, start, policy=policy, config=searched_within(0.9 * widest, 60))
        # In the image's corners alone it would be wide enough.
        for near in (1.1 * widest, 50.0):
            with pytest.raises(InputError, match="too small to be found"):
                PoseTracker(brick, CAMERA, start, policy=policy, config=searched_within(near, 60.0))
    blind = NearSighted(brick.inner(at(0.0)), 21.0)
    PoseTracker(brick, CAMERA, at(0.0), policy=blind, config=searched_within(50, 60))


def test_a_distance_is_checked_in_the_image_that_is_searched(brick: Mesh) -> None:
    camera = Camera.from_matrix(
        [[600.0, 0, 999.5], [0, 600, 999.5], [0, 0, 1]], 2000, 2000, [0.0] * 4,
        distortion_model="fisheye",
    )  # fmt: skip
    policy, side = Describing(brick.inner(at(0.0)), 21.0), camera.full_pinhole.width
    assert side > 2200, "or the test says nothing"
    widest = 600 * brick.sphere_diameter / (side / 60)
    config = searched_within(0.99 * widest, 60)
    PoseTracker(brick, camera, at(0.0), policy=policy, config=config)
    with pytest.raises(InputError, match="too small to be found"):
        config = searched_within(1.01 * widest, 60)
        PoseTracker(brick, camera, at(0.0), policy=policy, config=config)


def test_poses_that_a_search_gave_are_compared_with_their_half_turns(brick: Mesh) -> None:
    policy = Describing(brick.inner(at(0.0)), 21.0)
    tracker: Any = PoseTracker([brick] * 2, CAMERA, [at(0.0), None], policy=policy, found=True)

    def checked() -> list[bool]:
        looks = [one.look._unasked > 0 for one in tracker.supervisors]
        found = [one.check is not None for one in tracker.supervisors]
        assert looks == found
        return found

    assert checked() == [True, False], "none is known of the other"
    tracker.reset([at(0.0), at(0.1)])
    assert checked() == [False, False]
    tracker.reset([at(0.0), at(0.1)], found=[False, True])
    assert checked() == [False, True]
    with pytest.raises(InputError, match="found: 2 are needed, or one, found 1"):
        tracker.reset([at(0.0), at(0.1)], found=[True])
    never = TrackerConfig(recovery=RecoveryConfig(enabled=False))
    alone = PoseTracker(brick, CAMERA, at(0.0), policy=policy, config=never, found=True)
    assert alone.supervisors[0].check is None


def test_a_mesh_may_be_replaced_by_one_of_its_shape(brick: Mesh) -> None:
    vertices, faces = brick.vertices + brick.center, brick.faces
    plain = Mesh.from_arrays("plain", vertices, faces)
    policy = Describing(plain.inner(at(0.0)), 21.0)
    tracker: Any = PoseTracker(
        [plain, plain], CAMERA, [at(0.0), at(0.1)], policy=policy, found=[True, False]
    )
    before, kept = tracker.tracks[0], tracker.supervisors[1]
    tracker.replace_mesh(0, brick, at(0.0))
    assert tracker.meshes == [brick, plain] and tracker.supervisors[1] is kept
    assert tracker.tracks[0].mesh is brick and tracker.tracks[0].centred is before.centred
    assert tracker.supervisors[0].coloured and tracker.supervisors[0].check is not None
    assert tracker._taken(0, [1]) != [], "they are instances of one object still"
    larger = Mesh.from_arrays("larger", 2 * vertices, faces)
    with pytest.raises(InputError, match="larger has another size or middle than brick"):
        tracker.replace_mesh(0, larger, at(0.0))
    assert tracker.meshes == [brick, plain]


def test_whatever_is_tried_for_an_object_has_its_number(brick: Mesh) -> None:
    policy = Describing(brick.inner(at(0.0)), 0.0, doubt=0.3)
    never = dataclasses.replace(RecoveryConfig().second_look, below=0.0, after_found=0)
    config = dataclasses.replace(NO_CONTOUR, recovery=RecoveryConfig(second_look=never))
    other = dataclasses.replace(brick, name="other")
    tracker: Any = PoseTracker([other, brick], CAMERA, [None, at(0.0)], policy=policy,
                               config=config, found=True)  # fmt: skip
    tracker.supervisors[0].search = lambda *_: None
    tracker.update(GRAY)
    assert policy.numbers == {1}, "the first one is lost"
