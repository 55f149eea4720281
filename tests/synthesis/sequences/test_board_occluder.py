"""Boards hide the promised share in every frame, from the promised side."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from moveit6d.geometry.camera import Camera
from moveit6d.geometry.mesh import Mesh
from moveit6d.rendering.backends import make_renderer
from moveit6d.synthesis.objects.demo_object import demo_object
from moveit6d.synthesis.sequences.board_occluder import plan_board_occluder
from moveit6d.synthesis.sequences.difficulty import DIFFICULTIES
from moveit6d.synthesis.sequences.motion import random_motion
from moveit6d.synthesis.sequences.occlusion import visible_fraction
from moveit6d.synthesis.sequences.sequence import Scene

SMALL = Camera(205.0, 205.0, 106.0, 79.5, 213, 160)
FRAMES = 20


@pytest.fixture(scope="module")
def robot() -> Mesh:
    return demo_object()


@pytest.mark.parametrize("side", ["h", "v"])
@pytest.mark.parametrize("share", [0.15, 0.45])
def test_the_share_is_hidden_all_the_time(robot: Mesh, side: str, share: float) -> None:
    renderer = make_renderer("embree")
    rng = np.random.default_rng(int(100 * share))
    motion = random_motion(
        rng, SMALL, robot.sphere_diameter, FRAMES, pixels_per_frame=2.0, degrees_per_frame=3.0
    )
    board = plan_board_occluder(
        rng,
        renderer,
        robot,
        motion,
        FRAMES,
        side=side,
        share=share,  # type: ignore[arg-type]
    )
    hidden = []
    for time in (0, 3, 7.5, 12, 19):
        alone = visible_fraction(renderer, robot, motion, (), time)
        hidden.append(alone - visible_fraction(renderer, robot, motion, (board,), time))
    np.testing.assert_allclose(hidden, share, atol=0.05)
    assert np.mean(hidden) == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize(("side", "axis"), [("h", 1), ("v", 0)])
def test_a_board_stands_in_front_on_its_side(robot: Mesh, side: str, axis: int) -> None:
    difficulty = replace(DIFFICULTIES["easy"], board=side, board_occlusion=0.3)  # type: ignore[arg-type]
    scene = Scene(robot, 6, 8, difficulty, camera=SMALL)
    (board,) = scene.occluders
    assert board.kind == f"board {side}"
    board, inner = board.poses(np.array([4.0]))[0], scene.motion.pose(4)
    middle = board.translation - inner.translation
    assert middle[2] < -0.5 * robot.sphere_diameter, "nearer than any part of the object"
    assert abs(middle[axis]) > 3 * abs(middle[1 - axis])
    if side == "h":
        assert middle[1] > 0, "from below"
    assert scene.render_frame(4).visible_fraction == pytest.approx(0.7, abs=0.05)


def test_a_board_changes_nothing_else(robot: Mesh) -> None:
    plain = Scene(robot, 6, 8, "easy", camera=SMALL)
    difficulty = replace(DIFFICULTIES["easy"], board="v", board_occlusion=0.3)
    occluded = Scene(robot, 6, 8, difficulty, camera=SMALL)
    first, second = plain.render_frame(3), occluded.render_frame(3)
    assert bool((first.pose.matrix == second.pose.matrix).all())
    same = (np.abs(first.image.astype(int) - second.image) < 3).all(-1)
    assert 0.4 < same.mean() < 0.97, "background and motion are the same, the board is not"
