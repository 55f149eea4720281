"""Pyramid: pixels of cells, a ladder of widths, levels and patches of an image."""

from __future__ import annotations

import itertools

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from torch.nn import functional

from moveit6d.estimation.detection import PoseDetector
from moveit6d.estimation.detection.pyramid import Level, ladder
from moveit6d.frame import prepare_frame
from tests.estimation.detection.conftest import Picture
from tests.support import pictures

EMPTY = torch.zeros(1, 2, 2), torch.zeros(3, 2, 2)


@given(st.floats(10, 200), st.floats(1.0, 10.0), st.floats(1.05, 2.0))
def test_a_ladder_has_steps_no_longer_than_asked(low: float, ratio: float, step: float) -> None:
    widths = ladder(low, low * ratio, step)
    assert all(1 < b / a <= step * (1 + 1e-9) for a, b in itertools.pairwise(widths))
    if len(widths) > 1:
        assert widths[0] == pytest.approx(low) and widths[-1] == pytest.approx(low * ratio)
    else:
        assert low <= widths[0] <= low * ratio


def test_the_first_cell_covers_the_first_pixels() -> None:
    level = Level(64, 1.0, 0, 0, *EMPTY)
    assert level.pixel(0, 0) == (3.5, 3.5)  # the middle of pixels 0 to 7
    assert Level(32, 2.0, 10, 20, *EMPTY).pixel(1, 1) == (10 + 5.5, 20 + 5.5)


def test_a_level_is_made_once(seen: Picture, detector: PoseDetector) -> None:
    pyramid = detector.pyramid_of(prepare_frame(seen.image, pictures.CAMERA))
    level = pyramid.level(96.0)
    assert pyramid.level(96.0) is level
    assert level.features.shape[1:] == (22, 22)  # 256 · 64 / 96 = 171 pixels
    norms = level.features.norm(dim=0)
    torch.testing.assert_close(norms, torch.ones_like(norms), atol=1e-4, rtol=0)
    part = pyramid.level(96.0, (64, 0, 256, 128))
    assert part.features.shape[1:] == (11, 16) and part.left == 64


def test_descriptors_are_told_without_the_images_mean(
    seen: Picture, detector: PoseDetector
) -> None:
    frame = prepare_frame(seen.image, pictures.CAMERA)
    pyramid = detector.pyramid_of(frame)
    scaled = functional.interpolate(frame.pixels[None].float() / 255, (240, 240), mode="area")
    mean = detector.policy.descriptors(scaled)[0].mean((1, 2))
    assert float((pyramid.mean - mean).norm() / mean.norm()) < 0.1
    described = detector.policy.descriptors(frame.pixels[None].float() / 255)[0]
    without = described - pyramid.mean[:, None, None]
    level = pyramid.level(64.0)  # the image as it is
    torch.testing.assert_close(level.features, without / without.norm(dim=0), atol=1e-3, rtol=0)


def test_a_patch_looks_at_its_pixel(seen: Picture, detector: PoseDetector) -> None:
    pyramid = detector.pyramid_of(prepare_frame(seen.image, pictures.CAMERA))
    pixels = torch.tensor([[100.0, 140.0], [20.0, 200.0]])
    patches = pyramid.patches(pixels, torch.tensor([60.0, 90.0]), 9)
    assert patches.features.shape[2:] == (9, 9)
    assert patches.pixel(0, 0, 0) == pytest.approx((100, 140), abs=1e-6)
    assert patches.pixel(1, 0, 0) == pytest.approx((20, 200), abs=1e-6)
    # One cell is 8 of the 88 pixels that 60 pixels of the image are stretched to.
    u, v = patches.pixel(0, 1, -2)
    cell = 8 * 60 / detector.config.templates.width
    assert (u, v) == pytest.approx((100 + cell, 140 - 2 * cell), abs=0.2)


def test_the_background_is_the_same_for_all_objects(seen: Picture, detector: PoseDetector) -> None:
    frame = prepare_frame(seen.image, pictures.CAMERA)
    pyramid = detector.pyramid_of(frame)
    usual = pyramid.background(3, 9, 30.0, 90.0)
    assert usual is pyramid.background(3, 9, 30.0, 90.0) and len(usual.features) == 3
    again = detector.pyramid_of(frame).background(3, 9, 30.0, 90.0)
    assert torch.equal(usual.features, again.features)
