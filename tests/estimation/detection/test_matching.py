"""Matching: pixels of cells, a ladder of widths, and candidates where the object is."""

from __future__ import annotations

import itertools
import math

import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from moveit6d import InputError
from moveit6d.config import MatchConfig
from moveit6d.estimation.detection import PoseDetector
from moveit6d.estimation.detection.matching import Level, Matcher, Pyramid, ladder
from moveit6d.geometry.crop import look_at
from tests.estimation.detection.conftest import Picture
from tests.support import pictures


@given(st.floats(10, 200), st.floats(1.0, 10.0), st.floats(1.05, 2.0))
def test_a_ladder_has_steps_no_longer_than_asked(low: float, ratio: float, step: float) -> None:
    widths = ladder(low, low * ratio, step)
    assert all(1 < b / a <= step * (1 + 1e-9) for a, b in itertools.pairwise(widths))
    if len(widths) > 1:
        assert widths[0] == pytest.approx(low) and widths[-1] == pytest.approx(low * ratio)
    else:
        assert low <= widths[0] <= low * ratio


@given(st.floats(0, 300), st.floats(0, 300), st.floats(0.2, 3.0), st.integers(0, 50))
def test_cells_and_pixels_are_inverse(u: float, v: float, scale: float, left: int) -> None:
    level = Level(64 / scale, scale, left, 3, torch.zeros(1, 2, 2), torch.zeros(3, 2, 2))
    assert level.pixel(*level.cell(u, v)) == pytest.approx((u, v), abs=1e-6)


def test_the_first_cell_covers_the_first_pixels() -> None:
    level = Level(64, 1.0, 0, 0, torch.zeros(1, 2, 2), torch.zeros(3, 2, 2))
    assert level.pixel(0, 0) == (3.5, 3.5)  # the middle of pixels 0 to 7


def test_a_level_is_made_once(seen: Picture, detector: PoseDetector) -> None:
    image = torch.from_numpy(seen.image).permute(2, 0, 1) / 255
    pyramid = Pyramid(image, detector.policy.descriptors, 13, 64)
    level = pyramid.level(96.0)
    assert pyramid.level(96.0) is level
    assert level.features.shape[1:] == (22, 22)  # 256 · 64 / 96 = 171 pixels
    norms = level.features.norm(dim=0)
    torch.testing.assert_close(norms, torch.ones_like(norms), atol=1e-4, rtol=0)
    part = pyramid.level(96.0, (64, 0, 256, 128))
    assert part.features.shape[1:] == (11, 16) and part.left == 64


def test_the_object_is_among_the_candidates(seen: Picture, detector: PoseDetector) -> None:
    bank, config = detector.prepare(), detector.config
    image = torch.from_numpy(seen.image).permute(2, 0, 1) / 255
    pyramid = Pyramid(
        image, detector.policy.descriptors, config.match.local_mean, config.templates.width
    )
    matcher = Matcher(bank, config.match, config.templates.colour)
    for width in ladder(77, 154, config.match.step):
        matcher.add(pyramid.level(width))
    found = matcher.candidates()
    assert 0 < len(found) <= 2 * config.match.candidates
    best, more = (found.scores[: config.match.candidates], found[config.match.candidates :])
    assert (best.diff() <= 0).all() and best.min() >= more.scores.max()
    # Those of one place are no farther from each other than the cells around it.
    apart = float((more.pixels.amax(0) - more.pixels.amin(0)).max())
    assert apart > config.match.same_place * float(more.widths.max()), "more than one place"
    centred = seen.mesh.inner(seen.pose)
    pixel = pictures.CAMERA.project(centred.translation).float()
    diameter = torch.tensor(seen.mesh.sphere_diameter, dtype=torch.float64)
    width = 300 * float(diameter / centred.translation.norm())
    true = look_at(centred, diameter).rotation @ centred.rotation
    turn = (bank.fine.rotations[found.views] * true).sum((1, 2))
    degrees = torch.rad2deg(torch.arccos(((turn - 1) / 2).clamp(-1, 1)))
    near = (found.pixels - pixel).norm(dim=1) < 0.2 * width
    size = (found.widths / width).log().abs() < math.log(1.3)
    assert bool((near & size & (degrees < 35)).any())
    # What is not allowed is not proposed.
    nowhere = matcher.candidates(
        lambda pixels, widths, views: pixels[:, 0] < pixel[0] - 0.3 * width
    )
    assert (nowhere.pixels[:, 0] < pixel[0] - 0.3 * width).all()
    assert len(matcher.candidates(lambda pixels, *_: pixels[:, 0] < -1e4)) == 0


def test_settings_are_checked() -> None:
    with pytest.raises(InputError, match="smaller first"):
        MatchConfig(widths=(0.5, 0.1))
    with pytest.raises(InputError, match="1 or more"):
        MatchConfig(places=0)
    with pytest.raises(InputError, match="shortlist 1 or more"):
        MatchConfig(shortlist=0)
