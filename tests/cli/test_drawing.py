"""A picture of overlay.mp4: green where the pose is confident, red where it is not."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from moveit6d.cli.drawing import draw_step
from moveit6d.datasets.pose_files import PoseRow
from moveit6d.datasets.video import VideoFrame
from moveit6d.evaluation.run_tracker import TrackedFrame
from moveit6d.rendering.backends import make_renderer
from moveit6d.visualization.overlay import GREEN, RED, draw_pose


def drawn(scene: Any, confidence: float, pose: bool = True, image: bool = True) -> np.ndarray:
    frame = VideoFrame(3, "3.png", scene.image(3) if image else None, None if image else "damaged")
    row = PoseRow(3, "3.png", scene.pose(3) if pose else None, 2, "stop_action", confidence)
    step = TrackedFrame(frame, row, None)
    return np.asarray(draw_step(step, scene.mesh, scene.camera, make_renderer()))


@pytest.mark.parametrize(("confidence", "color"), [(0.9, GREEN), (0.1, RED)])
def test_the_colour_says_how_confident_it_is(scene: Any, confidence: float, color: Any) -> None:
    image = drawn(scene, confidence)
    expected = draw_pose(scene.image(3), scene.mesh, scene.pose(3), scene.camera, color=color)
    assert np.array_equal(image[:90], expected[:90]), "below it stands the text"
    assert not np.array_equal(image[90:], expected[90:])


def test_a_state_says_more_than_the_confidence(scene: Any) -> None:
    frame = VideoFrame(3, "3.png", scene.image(3), None)
    for state, color in (("tracking", GREEN), ("uncertain", RED)):
        row = PoseRow(3, "3.png", scene.pose(3), 2, "stop_action", 0.4, state=state)
        step = TrackedFrame(frame, row, None)
        image = draw_step(step, scene.mesh, scene.camera, make_renderer())
        expected = draw_pose(scene.image(3), scene.mesh, scene.pose(3), scene.camera, color=color)
        assert np.array_equal(np.asarray(image)[:90], expected[:90])


def test_without_a_pose_only_text_is_drawn(scene: Any) -> None:
    image = drawn(scene, 0.0, pose=False)
    changed = (image != scene.image(3)).any(-1)
    assert changed.any() and not changed[:80].any(), "the text stands at the bottom"


def test_a_frame_without_an_image_is_drawn_on_black(scene: Any) -> None:
    image = drawn(scene, 0.9, image=False)
    assert image.any() and (image == 0).all(-1).mean() > 0.5
