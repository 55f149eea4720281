"""Motion is smooth, as fast as asked for, and stays in the frame."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
import torch

from moveit6d.geometry.camera import Camera
from moveit6d.synthesis.sequences.motion import Motion, random_motion

CAMERA = Camera(600.0, 600.0, 319.5, 239.5, 640, 480)


def motion(seed: int, pixels: float = 6.0, degrees: float = 3.0) -> Motion:
    return random_motion(
        np.random.default_rng(seed),
        CAMERA,
        0.2,
        120,
        pixels_per_frame=pixels,
        degrees_per_frame=degrees,
    )


def angle(first: torch.Tensor, second: torch.Tensor) -> float:
    turn = first @ second.mT
    return float(torch.rad2deg(torch.arccos(((turn.diagonal().sum() - 1) / 2).clamp(-1, 1))))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize(("pixels", "degrees"), [(2.5, 1.2), (22.0, 9.0)])
def test_fastest_moment_has_the_speed_asked_for(seed: int, pixels: float, degrees: float) -> None:
    moving = motion(seed, pixels, degrees)
    moments = np.arange(0, 119, 0.125)
    way = moving.pixel(moments)[:, :2]
    fastest = np.linalg.norm(np.diff(way, axis=0), axis=1).max() * 8
    assert fastest == pytest.approx(pixels, rel=0.1)
    turns = [angle(moving.rotation(k + 1), moving.rotation(k)) for k in range(119)]
    assert 0.8 * degrees < max(turns) < 1.02 * degrees


@pytest.mark.parametrize("seed", range(6))
def test_stays_in_the_frame(seed: int) -> None:
    moving = motion(seed, 20.0)
    u, v, depth = moving.pixel(np.linspace(0, 119, 1000)).T
    radius = 0.5 * CAMERA.fx * 0.2 / depth
    assert (u - radius > -1).all() and (u + radius < 640).all()
    assert (v - radius > -1).all() and (v + radius < 480).all()


def test_pose_projects_to_its_pixel() -> None:
    moving = motion(1)
    for time in (-0.3, 0.0, 17.25, 119.4):
        pose = moving.pose(time)
        u, v, depth = moving.pixel(np.asarray(time))
        assert CAMERA.project(pose.translation).tolist() == pytest.approx([u, v])
        assert float(pose.translation[2]) == pytest.approx(depth)


def test_motion_is_smooth() -> None:
    moving = motion(2, 20.0, 9.0)
    moments = np.arange(0, 118, 0.01)
    way = moving.pixel(moments)[:, :2]
    jerk = np.abs(np.diff(way, n=2, axis=0)).max() / 0.01**2
    assert jerk < 10  # pixels a frame²: no kicks
    turns = [moving.rotation(float(t)) for t in moments[:800]]
    steps = [angle(b, a) for a, b in pairwise(turns)]
    assert max(steps) < 9.2 * 0.01


def test_rotations_stay_rotations() -> None:
    turn = motion(3, degrees=10).rotations
    identity = torch.eye(3, dtype=torch.float64)
    assert float((turn @ turn.mT - identity).abs().max()) < 1e-9
