"""What is a solid of revolution, and which of a track's frames teach something."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch

from moveit6d import Mesh, Pose
from moveit6d.datasets.video import VideoFrame
from moveit6d.estimation import StopReason, TrackingResult
from tools import tracked_frames as module
from tools.tracked_frames import (
    Example,
    is_round,
    tracked_frames,
    uncoloured_frames,
    without_colours,
)


def cylinder(corners: int, squeezed: float = 1.0) -> Mesh:
    angles = np.arange(corners) * 2 * np.pi / corners
    ring = np.column_stack([squeezed * np.cos(angles), np.sin(angles)])
    ends = [np.column_stack([ring, np.full(corners, z)]) for z in (-1.0, 1.0)]
    vertices = 0.05 * np.vstack([*ends, [[0, 0, -1.0], [0, 0, 1.0]]]) + [0.3, 0, 0]
    faces = []
    for k in range(corners):
        a, b = k, (k + 1) % corners
        c, d = a + corners, b + corners
        faces += [[a, b, c], [b, d, c], [2 * corners, b, a], [2 * corners + 1, c, d]]
    return Mesh.from_arrays("cylinder", vertices, faces)


def test_a_cylinder_is_round_and_a_flat_bottle_is_not(brick: Mesh) -> None:
    assert is_round(cylinder(40))
    assert not is_round(cylinder(40, squeezed=0.5)) and not is_round(brick)


def test_a_mesh_without_colours_stays_where_it_is(brick: Mesh) -> None:
    plain = without_colours(brick)
    assert brick.has_colours and not plain.has_colours
    np.testing.assert_allclose(plain.center, brick.center, atol=1e-9)
    np.testing.assert_allclose(plain.sample_points(9), brick.sample_points(9), atol=1e-7)


@pytest.mark.parametrize("coloured", [True, False])
def test_a_track_that_drifts_starts_anew_only_without_colours(
    brick: Mesh, monkeypatch: pytest.MonkeyPatch, coloured: bool
) -> None:
    resets: list[int] = []

    class Stage:
        camera = type("Size", (), {"width": 4, "height": 3})

        def __init__(self, *_: Any) -> None: ...

        def render_frame(self, k: int) -> Any:
            frame = type("Rendered", (), {})()
            frame.pose, frame.image = truth, np.zeros((3, 4, 3), np.uint8)
            return frame

    class Drifting:
        """Off by a diameter in every frame after the tenth since it was set."""

        def __init__(self, mesh: Mesh, *_: Any, **__: Any) -> None:
            assert mesh.has_colours is coloured
            self.frame = self.since = 0

        def reset(self, pose: Pose) -> None:
            resets.append(self.frame)
            self.since = 0

        def update(self, image: Any) -> TrackingResult:
            self.frame, self.since = self.frame + 1, self.since + 1
            off = brick.diameter if self.since > 10 else 0.0
            pose = Pose(truth.rotation, truth.translation + torch.tensor([off, 0.0, 0.0]))
            reason = StopReason.STOP_ACTION
            return TrackingResult(pose, 3, reason, 0.9, 5.0, contour_agreement=0.5)

    truth = Pose.from_rvec([0, 0, 0], [0, 0, 1])
    monkeypatch.setattr(module, "DIFFICULTIES", ("hard",))
    monkeypatch.setattr(module, "Scene", Stage)
    monkeypatch.setattr(module, "PoseTracker", Drifting)
    photo = np.zeros((3, 4, 3), np.uint8)

    examples = list(tracked_frames(brick, [photo], None, 0, coloured))  # type: ignore[arg-type]
    errors = [one.error for one in examples]
    assert {one.evidence for one in examples} == {(0.9, 0.5)}
    gone = module.GONE if coloured else module.UNCOLOURED_GONE
    assert len(errors) == (43 if coloured else 59)
    assert {k for k, error in enumerate(errors, 1) if np.isinf(error)} == {*gone}
    assert resets == ([29] if coloured else [18, 36, 55])


def test_sequences_that_were_made_before_are_tracked_without_colours(
    brick: Mesh, monkeypatch: pytest.MonkeyPatch
) -> None:
    truth = Pose.from_rvec([0, 0, 0], [0, 0, 1])

    class Still:
        def __init__(self, mesh: Mesh, *_: Any, **__: Any) -> None:
            assert not mesh.has_colours

        def update(self, image: Any) -> TrackingResult:
            reason = StopReason.STOP_ACTION
            return TrackingResult(truth, 3, reason, 0.8, 5.0, contour_agreement=0.5)

    class Made:
        name, camera = "hard_brick", None
        truth = dict.fromkeys(range(4), Pose.from_rvec([0, 0, 0], [0, 0, 1]))

        def load_mesh(self) -> Mesh:
            return brick

        def open(self) -> list[VideoFrame]:
            picture = np.zeros((3, 4, 3), np.uint8)
            return [VideoFrame(k, "", None if k == 2 else picture) for k in range(6)]

    monkeypatch.setattr(module, "read_sequences", lambda _: [Made()])
    monkeypatch.setattr(module, "PoseTracker", Still)
    found = list(uncoloured_frames(Path("made"), None))  # type: ignore[arg-type]
    # The first gives the start; one picture is damaged, and of two nobody knows the pose.
    assert found == [Example((0.8, 0.5), 0.0, "brick")] * 2
