"""Where the next frame starts: constant velocity against SciPy, and what is remembered."""

from dataclasses import replace

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from moveit6d.actions import pose_delta
from moveit6d.config import PAPER_CONFIG, KeyframeConfig, TrackerConfig
from moveit6d.contour import ColourHistograms
from moveit6d.estimation.keyframes import KeyframeMemory
from moveit6d.estimation.track_state import TrackState
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.geometry.symmetry import Symmetries
from tests.support.configs import HIGH_CONFIDENCE, LOW_CONFIDENCE

MOTION = TrackerConfig().motion


def moving(mesh: Mesh, frame: int) -> Pose:
    """An object that turns and drifts evenly about its centre."""
    turn = Rotation.from_rotvec(np.array([0.02, -0.1, 0.05]) * frame).as_matrix()
    place = np.array([0.03, -0.02, 0.04]) * frame + [0.0, 0.0, 0.8]
    return Pose(torch.from_numpy(turn), torch.from_numpy(place))


def above_high(track: TrackState, *poses: Pose) -> TrackState:
    for pose in poses:
        track.add(pose, 1.0)
    return track


def test_an_even_motion_is_continued(brick: Mesh) -> None:
    track = above_high(
        TrackState.begin(brick, moving(brick, 0)), moving(brick, 1), moving(brick, 2)
    )
    last, ahead = track.starts()
    torch.testing.assert_close(last.matrix, moving(brick, 2).matrix)
    torch.testing.assert_close(ahead.matrix, moving(brick, 3).matrix)


def test_an_object_at_rest_has_one_start(brick: Mesh) -> None:
    track = above_high(TrackState.begin(brick, moving(brick, 1)), moving(brick, 1))
    assert len(track.starts()) == 1


def test_in_the_paper_s_way_every_frame_starts_at_the_last_pose_alone(brick: Mesh) -> None:
    track = above_high(
        TrackState.begin(brick, moving(brick, 0), PAPER_CONFIG), moving(brick, 1), moving(brick, 2)
    )
    track.add(moving(brick, 4), LOW_CONFIDENCE - 0.1)
    (start,) = track.starts()
    torch.testing.assert_close(start.matrix, moving(brick, 4).matrix)


def test_a_pose_of_low_confidence_is_not_extrapolated_and_the_last_good_one_kept(
    brick: Mesh,
) -> None:
    track = above_high(TrackState.begin(brick, moving(brick, 0)), moving(brick, 1))
    track.add(moving(brick, 4), LOW_CONFIDENCE - 0.1)
    track.add(moving(brick, 6), LOW_CONFIDENCE - 0.1)
    last, last_confident_pose, *_ = track.starts()
    torch.testing.assert_close(last.matrix, moving(brick, 6).matrix)
    torch.testing.assert_close(last_confident_pose.matrix, moving(brick, 1).matrix)


def test_half_sure_poses_are_gone_on_from_but_neither_continued_nor_gone_back_to(
    brick: Mesh,
) -> None:
    track = above_high(TrackState.begin(brick, moving(brick, 0)), moving(brick, 1))
    for frame in (3, 6):
        track.add(moving(brick, frame), (HIGH_CONFIDENCE + LOW_CONFIDENCE) / 2)
        assert track.above_low
        (only,) = track.starts()
        torch.testing.assert_close(only.matrix, moving(brick, frame).matrix)
    track.miss()
    torch.testing.assert_close(track.starts()[1].matrix, moving(brick, 1).matrix)


def test_an_object_in_doubt_is_likely_on_its_way_and_slows_down(brick: Mesh) -> None:
    track = above_high(
        TrackState.begin(brick, moving(brick, 0)), *(moving(brick, k) for k in (1, 2, 3))
    )
    diameter = torch.tensor(brick.sphere_diameter, dtype=torch.float64)
    ways = []
    for _ in range(60):
        last, seen, ahead = track.recovery_poses()
        assert last is track.centred
        torch.testing.assert_close(seen.matrix, moving(brick, 3).matrix)
        ways.append(((ahead).translation - (seen).translation).norm())
        track.add(moving(brick, 9), LOW_CONFIDENCE - 0.1)
    step = (moving(brick, 1)).translation - (moving(brick, 0)).translation
    torch.testing.assert_close(ways[0], step.norm())
    apart = np.diff(torch.stack(ways).numpy())
    np.testing.assert_allclose(apart[1:] / apart[:-1], MOTION.velocity_decay, rtol=1e-6)
    first = TrackState.begin(brick, moving(brick, 3))
    first = above_high(first, moving(brick, 4))
    delta = pose_delta((first.recovery_poses()[2]), (moving(brick, 5)), diameter)
    assert delta.abs().max() < 1e-6, "in the next frame it is where the motion leads"


def test_a_motion_is_a_mean_and_forgotten_in_a_gap(brick: Mesh) -> None:
    here = moving(brick, 0)
    track = above_high(TrackState.begin(brick, here), here, moving(brick, 1))
    assert track.mean_velocity is not None and track.velocity is not None
    torch.testing.assert_close(track.mean_velocity, MOTION.velocity_rate * track.velocity)
    track.miss()
    assert track.mean_velocity is not None, "it is what says where to look"
    track.add(here, 1.0)
    assert track.mean_velocity is None and track.frames_unconfident == 0
    assert track.recovery_poses() == (here, here, here)


def test_belief_comes_back(brick: Mesh) -> None:
    track = above_high(TrackState.begin(brick, moving(brick, 0)), moving(brick, 1))
    track.miss()
    assert not track.above_low
    track.add(moving(brick, 1), 1.0)
    assert track.above_low and len(track.starts()) == 1


def test_only_what_was_sure_and_hardly_moved_is_looked_at_closely_at_once(brick: Mesh) -> None:
    here = moving(brick, 0)
    track = TrackState.begin(brick, here)
    assert not track.slow, "a start may be far off"
    track.add(here, 1.0)
    assert track.slow
    track.add(moving(brick, 1), 1.0)
    assert not track.slow, "it moved by ten units and more"
    track.add(moving(brick, 1), (HIGH_CONFIDENCE + LOW_CONFIDENCE) / 2)
    assert not track.slow
    track.add(moving(brick, 1), 1.0)
    assert track.slow
    track.miss()
    assert not track.slow


def test_histograms_are_updated_from_confident_frames(brick: Mesh) -> None:
    first, second = (ColourHistograms(np.full(8, v), np.full(8, 1 - v)) for v in (0.0, 1.0))
    track = TrackState.begin(brick, moving(brick, 0))
    track.add(moving(brick, 1), LOW_CONFIDENCE - 0.1)
    track.update_histograms(first)
    assert track.histograms is None
    track = above_high(track, moving(brick, 1))
    track.update_histograms(None)
    assert track.histograms is None
    track.update_histograms(first)
    track.update_histograms(second)
    assert track.histograms is not None
    np.testing.assert_allclose(track.histograms.inside, TrackerConfig().contour.histogram_rate)
    np.testing.assert_allclose(track.histograms.outside, 1 - TrackerConfig().contour.histogram_rate)


def test_recovery_starts_become_rare_while_the_confidence_stays_low(brick: Mesh) -> None:
    track = TrackState.begin(brick, moving(brick, 0))
    due = []
    for frame in range(12):
        due.append(track.is_recovery_due())
        if frame % 2:
            track.miss()
        else:
            track.add(moving(brick, 0), LOW_CONFIDENCE - 0.1)
    assert due == [True, True, False, False, True] + [False, False, True] * 2 + [False]
    track.add(moving(brick, 0), LOW_CONFIDENCE)
    assert track.is_recovery_due() and track.frames_low == 0


def test_a_new_beginning_keeps_what_is_known_and_takes_the_equivalent_nearest_to_the_last(
    brick: Mesh,
) -> None:
    turn = np.diag([1.0, -1.0, -1.0, 1.0])
    turn[:3, 3] = brick.center - turn[:3, :3] @ brick.center
    box = replace(brick, symmetries=Symmetries(turn[None]))
    config = TrackerConfig(keyframes=KeyframeConfig(enabled=True))
    track = TrackState.begin(box, moving(box, 0), config)
    track.depth_bias, sure = 0.4, KeyframeMemory(config.keyframes)
    over = moving(box, 1).rotation @ torch.from_numpy(turn[:3, :3])
    again = track.begin_again(Pose(over, moving(box, 1).translation), sure)
    torch.testing.assert_close(again.centred.matrix, moving(box, 1).matrix)
    assert again.depth_bias == 0.4 and again.keyframes is again.sure_keyframes is sure


def test_a_generator_of_symmetries_stands_for_all_of_its_powers(brick: Mesh) -> None:
    quarter = np.eye(4)
    quarter[:2, :2] = [[0, -1], [1, 0]]
    quarter[:3, 3] = brick.center - quarter[:3, :3] @ brick.center
    post = replace(brick, symmetries=Symmetries(quarter[None]))
    track = TrackState.begin(post, moving(post, 0))
    half = torch.from_numpy(quarter[:3, :3] @ quarter[:3, :3])
    there = moving(post, 0)
    track.add(Pose(there.rotation @ half, there.translation), 0.9)
    torch.testing.assert_close(track.centred.matrix, there.matrix)


def test_what_leads_from_a_found_pose_to_that_of_the_same_frame_is_no_motion(brick: Mesh) -> None:
    track = above_high(
        TrackState.begin(brick, moving(brick, 0)), *[moving(brick, k) for k in (1, 2)]
    )
    assert track.velocity is not None
    found = track.begin_again(moving(brick, 5), None)
    found.add(moving(brick, 6), 1.0)
    assert not found.slow and found.velocity is None and found.mean_velocity is None
    assert len(found.starts()) == 1
    found.add(moving(brick, 7), 1.0)
    torch.testing.assert_close(found.starts()[1].matrix, moving(brick, 8).matrix)
