"""Where the next frame starts: constant velocity against SciPy, and what is remembered."""

import numpy as np
import torch
from scipy.spatial.transform import Rotation

from moveit6d.actions import difference
from moveit6d.estimation.hypotheses import (
    DOUBTFUL,
    LEARNING,
    MOTION_LEARNING,
    PERSISTENCE,
    SURE,
    Track,
)
from moveit6d.geometry.mesh import Mesh
from moveit6d.geometry.pose import Pose
from moveit6d.regions import Colours


def moving(mesh: Mesh, frame: int) -> Pose:
    """An object that turns and drifts evenly about its centre."""
    turn = Rotation.from_rotvec(np.array([0.02, -0.1, 0.05]) * frame).as_matrix()
    place = np.array([0.03, -0.02, 0.04]) * frame + [0.0, 0.0, 0.8]
    return mesh.outer(Pose(torch.from_numpy(turn), torch.from_numpy(place)))


def sure(track: Track, *poses: Pose) -> Track:
    for pose in poses:
        track.add(pose, 1.0)
    return track


def test_an_even_motion_is_continued(brick: Mesh) -> None:
    track = sure(Track.begin(brick, moving(brick, 0)), moving(brick, 1), moving(brick, 2))
    last, ahead = track.starts()
    torch.testing.assert_close(last.matrix(), moving(brick, 2).matrix())
    torch.testing.assert_close(ahead.matrix(), moving(brick, 3).matrix())


def test_an_object_at_rest_has_one_start(brick: Mesh) -> None:
    track = sure(Track.begin(brick, moving(brick, 1)), moving(brick, 1))
    assert len(track.starts()) == 1


def test_a_doubtful_pose_is_not_extrapolated_and_the_trusted_one_is_kept(brick: Mesh) -> None:
    track = sure(Track.begin(brick, moving(brick, 0)), moving(brick, 1))
    track.add(moving(brick, 4), DOUBTFUL - 0.1)
    track.add(moving(brick, 6), DOUBTFUL - 0.1)
    last, trusted, *_ = track.starts()
    torch.testing.assert_close(last.matrix(), moving(brick, 6).matrix())
    torch.testing.assert_close(trusted.matrix(), moving(brick, 1).matrix())


def test_half_sure_poses_are_gone_on_from_but_neither_continued_nor_gone_back_to(
    brick: Mesh,
) -> None:
    track = sure(Track.begin(brick, moving(brick, 0)), moving(brick, 1))
    for frame in (3, 6):
        track.add(moving(brick, frame), (SURE + DOUBTFUL) / 2)
        assert track.believed
        (only,) = track.starts()
        torch.testing.assert_close(only.matrix(), moving(brick, frame).matrix())
    track.miss()
    torch.testing.assert_close(track.starts()[1].matrix(), moving(brick, 1).matrix())


def test_an_object_in_doubt_is_likely_on_its_way_and_slows_down(brick: Mesh) -> None:
    track = sure(Track.begin(brick, moving(brick, 0)), *(moving(brick, k) for k in (1, 2, 3)))
    diameter = torch.tensor(brick.sphere_diameter, dtype=torch.float64)
    ways = []
    for _ in range(60):
        last, seen, ahead = track.likely()
        assert last is track.pose
        torch.testing.assert_close(seen.matrix(), moving(brick, 3).matrix())
        ways.append((brick.inner(ahead).translation - brick.inner(seen).translation).norm())
        track.add(moving(brick, 9), DOUBTFUL - 0.1)
    step = brick.inner(moving(brick, 1)).translation - brick.inner(moving(brick, 0)).translation
    torch.testing.assert_close(ways[0], step.norm())
    apart = np.diff(torch.stack(ways).numpy())
    np.testing.assert_allclose(apart[1:] / apart[:-1], PERSISTENCE, rtol=1e-6)
    first = Track.begin(brick, moving(brick, 3))
    first = sure(first, moving(brick, 4))
    counts = difference(brick.inner(first.likely()[2]), brick.inner(moving(brick, 5)), diameter)
    assert counts.abs().max() < 1e-6, "in the next frame it is where the motion leads"


def test_a_motion_is_a_mean_and_forgotten_in_a_gap(brick: Mesh) -> None:
    here = moving(brick, 0)
    track = sure(Track.begin(brick, here), here, moving(brick, 1))
    assert track.motion is not None and track.velocity is not None
    torch.testing.assert_close(track.motion, MOTION_LEARNING * track.velocity)
    track.miss()
    assert track.motion is not None, "it is what says where to look"
    track.add(here, 1.0)
    assert track.motion is None and track.unsure == 0
    assert track.likely() == (here, here, here)


def test_belief_comes_back(brick: Mesh) -> None:
    track = sure(Track.begin(brick, moving(brick, 0)), moving(brick, 1))
    track.miss()
    assert not track.believed
    track.add(moving(brick, 1), 1.0)
    assert track.believed and len(track.starts()) == 1


def test_only_what_was_sure_and_hardly_moved_is_looked_at_closely_at_once(brick: Mesh) -> None:
    here = moving(brick, 0)
    track = Track.begin(brick, here)
    assert not track.steady, "a start may be far off"
    track.add(here, 1.0)
    assert track.steady
    track.add(moving(brick, 1), 1.0)
    assert not track.steady, "it moved by ten counts and more"
    track.add(moving(brick, 1), (SURE + DOUBTFUL) / 2)
    assert not track.steady
    track.add(moving(brick, 1), 1.0)
    assert track.steady
    track.miss()
    assert not track.steady


def test_colours_are_learnt_from_frames_that_are_believed(brick: Mesh) -> None:
    first, second = (Colours(np.full(8, v), np.full(8, 1 - v)) for v in (0.0, 1.0))
    track = Track.begin(brick, moving(brick, 0))
    track.add(moving(brick, 1), DOUBTFUL - 0.1)
    track.learn(first)
    assert track.colours is None
    track = sure(track, moving(brick, 1))
    track.learn(None)
    assert track.colours is None
    track.learn(first)
    track.learn(second)
    assert track.colours is not None
    np.testing.assert_allclose(track.colours.inside, LEARNING)
    np.testing.assert_allclose(track.colours.outside, 1 - LEARNING)
