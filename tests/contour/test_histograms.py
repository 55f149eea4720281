"""Histograms of colours: against a plain loop, and what they say of a picture."""

import numpy as np
import pytest

from moveit6d.config import ContourConfig
from moveit6d.contour.histograms import ColourHistograms, colour_bins, estimate_histograms

CONFIG = ContourConfig()
BINS = CONFIG.bins

SEEN = np.ones((64, 64), bool)


def square(low: int = 20, high: int = 44) -> np.ndarray:
    mask = np.zeros((64, 64), bool)
    mask[low:high, low:high] = True
    return mask


def test_densities_are_those_of_a_plain_loop() -> None:
    patch = np.random.default_rng(0).integers(0, 256, (64, 64, 3)).astype(np.uint8)
    mask = square()
    learnt = estimate_histograms(patch, mask, SEEN, CONFIG)
    assert learnt is not None
    expected = np.zeros((BINS, BINS, BINS))
    line = np.arange(BINS)
    for row, column in zip(*np.nonzero(mask), strict=True):  # the square is thinner than the band
        each = [
            np.exp(-0.5 * ((line - int(v) * BINS // 256) / CONFIG.bin_blur) ** 2)
            for v in patch[row, column]
        ]
        r, g, b = (spread / spread.sum() for spread in each)
        expected += r[:, None, None] * g[:, None] * b
    expected /= mask.sum()
    np.testing.assert_allclose(learnt.inside.reshape(expected.shape), expected, atol=1e-6)
    assert learnt.outside.sum() == pytest.approx(1, abs=1e-4)


def test_a_bin_is_eight_levels_of_each_channel() -> None:
    histograms = np.array([[0, 0, 0], [7, 0, 8], [255, 255, 255], [0, 16, 0]], np.uint8)
    assert colour_bins(histograms, BINS).tolist() == [0, 1, BINS**3 - 1, 2 * BINS]


def test_only_the_bands_along_the_outline_are_learnt() -> None:
    patch = np.full((64, 64, 3), 200, np.uint8)
    mask = np.zeros((64, 64), bool)
    mask[:, 32:] = True
    patch[:, 32:] = 40
    patch[:, : 32 - int(CONFIG.band) - 2] = (250, 10, 10)  # too far out
    learnt = estimate_histograms(patch, mask, SEEN, CONFIG)
    assert learnt is not None
    far = colour_bins(np.array([250, 10, 10], np.uint8), BINS)
    assert learnt.outside[far] == 0


def test_log_odds_tell_the_object_from_its_surroundings() -> None:
    patch = np.full((64, 64, 3), 200, np.uint8)
    mask = square()
    patch[mask] = 40
    learnt = estimate_histograms(patch, mask, SEEN, CONFIG)
    assert learnt is not None
    unseen = SEEN.copy()
    unseen[:5] = False
    odds = learnt.log_odds(patch, unseen, CONFIG)
    assert (odds[mask] > 3).all() and (odds[5:][~mask[5:]] < -3).all()
    assert (odds[:5] == 0).all()
    strange = np.full((64, 64, 3), (250, 0, 120), np.uint8)
    assert (
        np.abs(learnt.log_odds(strange, SEEN, CONFIG)).max() < 1e-3
    )  # a colour of neither says nothing


def test_nothing_is_learnt_where_there_is_too_little_to_see() -> None:
    patch = np.zeros((64, 64, 3), np.uint8)
    assert estimate_histograms(patch, np.zeros((64, 64), bool), SEEN, CONFIG) is None
    assert estimate_histograms(patch, np.ones((64, 64), bool), SEEN, CONFIG) is None
    assert estimate_histograms(patch, square(), ~SEEN, CONFIG) is None


def test_blending_forgets_a_part() -> None:
    one, other = np.zeros(BINS**3, np.float32), np.zeros(BINS**3, np.float32)
    one[3] = other[7] = 1
    mixed = ColourHistograms(one, other).blend(ColourHistograms(other, one), 0.25)
    assert mixed.inside[[3, 7]].tolist() == [0.75, 0.25]
    assert mixed.outside[[3, 7]].tolist() == [0.25, 0.75]
