"""The camera of a sequence: values survive but for noise, edges mix light."""

from __future__ import annotations

import numpy as np
import pytest

from moveit6d.synthesis.imaging.linear_light import GAMMA
from moveit6d.synthesis.sequences.sensor import Sensor, expose


def test_exposure_keeps_values_within_noise() -> None:
    picture = np.full((40, 40, 3), (30, 128, 220), np.uint8)
    light = ((picture / 255) ** GAMMA).astype(np.float32)
    quiet = Sensor(blur=0.5, exposure=1.0, read_noise=0.0, shot_noise=0.0)
    seen = expose(np.random.default_rng(0), light, quiet)
    assert np.abs(seen.astype(int) - picture).max() <= 1
    noisy = Sensor(blur=0.5, exposure=1.0, read_noise=0.003, shot_noise=0.02)
    seen = expose(np.random.default_rng(0), light, noisy)
    assert 0.3 < seen[..., 1].std() < 6


def test_the_lens_mixes_light_at_an_edge() -> None:
    edge = np.zeros((9, 40, 3), np.float32)
    edge[:, 20:] = 1
    seen = expose(np.random.default_rng(0), edge, Sensor(2.0, 1.0, 0.0, 0.0))[4, :, 0] / 255
    assert (seen[19] ** GAMMA + seen[20] ** GAMMA) == pytest.approx(1, abs=0.02)
    assert seen[19] + seen[20] > 1.3, "display colours are brighter there than their mean"


def test_exposure_is_a_gain_and_highlights_are_clipped() -> None:
    light = np.full((6, 6, 3), 0.4, np.float32)
    once, twice = (
        expose(np.random.default_rng(0), light, Sensor(0.5, gain, 0.0, 0.0)) for gain in (1, 2)
    )
    assert (twice / 255) ** GAMMA == pytest.approx(2 * (once / 255) ** GAMMA, rel=0.02)
    assert (expose(np.random.default_rng(0), light, Sensor(0.5, 9, 0.0, 0.0)) == 255).all()
