"""A picture within a photograph, and its camera there."""

from __future__ import annotations

import numpy as np
import pytest
import torch

from moveit6d import Camera
from tools.scenes import within_photo


def test_a_picture_within_a_photograph_is_where_its_camera_sees_it() -> None:
    camera = Camera(300.0, 310.0, 150.0, 130.0, 320, 240)
    point = torch.tensor([0.05, -0.03, 0.6], dtype=torch.float64)
    u, v = (round(x) for x in camera.project(point).tolist())
    image = np.zeros((240, 320, 3), np.uint8)
    image[v - 3 : v + 4, u - 3 : u + 4] = 255
    photo = np.zeros((100, 100, 3), np.uint8)
    for seed in range(5):
        placed, there = within_photo(np.random.default_rng(seed), image, camera, photo)
        assert placed.shape == image.shape
        rows, columns = np.nonzero(placed[..., 0] > 127)
        expected = there.project(point).tolist()
        assert expected == pytest.approx([columns.mean(), rows.mean()], abs=0.7)
