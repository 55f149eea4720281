"""Pictures by code: right shape, repeatable, with contrast at several scales."""

from __future__ import annotations

import numpy as np
import pytest

from moveit6d.synthesis.augmentation.backgrounds import procedural_photo
from moveit6d.synthesis.objects.textures import paint, random_palette, smooth_noise


@pytest.mark.parametrize("size", [(48, 64), (120, 90), (61, 103)])
def test_any_size(size: tuple[int, int]) -> None:
    for seed in range(8):
        picture = procedural_photo(np.random.default_rng(seed), size)
        assert picture.shape == (*size, 3) and picture.dtype == np.uint8


def test_repeatable_and_varied() -> None:
    first, again, other = (procedural_photo(np.random.default_rng(s), (60, 80)) for s in (1, 1, 2))
    np.testing.assert_array_equal(first, again)
    assert np.abs(first.astype(int) - other).mean() > 10


def test_pictures_have_contrast() -> None:
    pictures = [procedural_photo(np.random.default_rng(s), (90, 120)) for s in range(12)]
    assert np.mean([picture.std() for picture in pictures]) > 25


def test_noise_is_normalised() -> None:
    noise = smooth_noise(np.random.default_rng(0), 100, 140, 3, 5)
    assert noise.shape == (100, 140)
    assert noise.std() == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("size", [(1, 1), (3, 200), (85, 128), (256, 256)])
def test_paint_any_size(size: tuple[int, int]) -> None:
    for seed in range(30):
        rng = np.random.default_rng(seed)
        picture = paint(rng, *size, random_palette(rng))
        assert picture.shape == (*size, 3) and picture.dtype == np.uint8


def test_plain_paint_has_one_colour() -> None:
    rng = np.random.default_rng(0)
    picture = paint(rng, 64, 64, random_palette(rng), plain=True)
    assert picture.std(axis=(0, 1)).max() < 12
