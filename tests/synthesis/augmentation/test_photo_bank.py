"""Squares of photographs: where they come from, and how they are scaled."""

import numpy as np
import torch

from moveit6d.synthesis.augmentation.photo_bank import PhotoBank
from tests.support.pairs import rng

CPU = torch.device("cpu")


def test_squares_show_one_photo_each_and_all_of_them() -> None:
    photos = [np.full((60 + 7 * k, 90, 3), 20 * k, np.uint8) for k in range(10)]
    seen = PhotoBank(photos, CPU).squares(200, 32, rng())
    assert seen.shape == (200, 3, 32, 32)
    assert (seen.flatten(1).amax(1) - seen.flatten(1).amin(1)).max() < 1e-6
    assert len(torch.unique((seen[:, 0, 0, 0] * 255 / 20).round())) == 10


def test_a_gradient_stays_one_and_is_mirrored_half_of_the_time() -> None:
    ramp = np.repeat(np.arange(200, dtype=np.uint8)[None, :, None], 100, 0).repeat(3, 2)
    seen = PhotoBank([ramp], CPU).squares(400, 48, rng())[:, 0] * 255
    steps = seen[:, :, 1:] - seen[:, :, :-1]
    inner = steps[:, :, 2:-2]
    assert (inner.amax((1, 2)) - inner.amin((1, 2))).max() < 0.02, "linear within each"
    assert abs(float((inner.mean((1, 2)) > 0).float().mean()) - 0.5) < 0.1
    sides = inner.mean((1, 2)).abs() * 48
    assert 47 < sides.min() < 60 and 90 < sides.max() < 101, "from 48 pixels to the whole height"
