"""Places and views: candidates are where the object is, and as it is turned."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import pytest
import torch
from torch.nn import functional

from moveit6d import Camera, InputError
from moveit6d.config import MatchConfig
from moveit6d.estimation.detection import PoseDetector
from moveit6d.estimation.detection.places import (
    HALVES,
    WHOLE,
    Part,
    Place,
    PlaceFinder,
    _correlation,
    _part_of,
    spread_of,
)
from moveit6d.estimation.detection.pyramid import Level, ladder
from moveit6d.estimation.detection.templates import Templates
from moveit6d.estimation.detection.views import ViewMatcher, best_candidates, seen_mean
from moveit6d.frame import prepare_frame
from moveit6d.geometry.crop import look_at
from tests.estimation.detection.conftest import Picture
from tests.support import pictures


def test_the_object_is_among_the_candidates(seen: Picture, detector: PoseDetector) -> None:
    bank, config = detector.prepare(), detector.config
    pyramid = detector.pyramid_of(prepare_frame(seen.image, pictures.CAMERA))
    finder = PlaceFinder(bank.coarse, config.match, config.templates.colour)
    for width in ladder(77, 154, config.match.step):
        finder.add(pyramid.level(width))
    places = finder.places(config.match.places)
    assert [place.score for place in finder.places(2)] == [place.score for place in places[:2]]
    matcher = ViewMatcher(bank.fine, pyramid, config.match)
    views = [matcher.views(place) for place in places]
    found = best_candidates(views, 12)
    assert len(found) == 12 and (found.scores.diff() <= 0).all()
    every = torch.cat([one.scores for one in views]).sort(descending=True).values
    torch.testing.assert_close(found.scores, every[:12])
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
    for place in places:
        left = matcher.views(place, lambda pixels, *_: pixels[:, 0] < pixel[0] - 0.3 * width)
        assert (left.pixels[:, 0] < pixel[0] - 0.3 * width).all()
        assert len(matcher.views(place, lambda pixels, *_: pixels[:, 0] < -1e4)) == 0
    assert len(best_candidates([], 3)) == 0


@pytest.mark.parametrize("degrees", [0, 50])
def test_views_are_tried_as_far_away_as_a_place_says(
    detector: PoseDetector, degrees: float
) -> None:
    camera = Camera.from_fov(110, 256, 256)
    image = pictures.mottled(0)
    frame = prepare_frame(image, camera)
    bank, config = detector.prepare(), detector.config.match
    matcher = ViewMatcher(bank.fine, detector.pyramid_of(frame), config)
    u = camera.cx + camera.fx * math.tan(math.radians(degrees))
    width = 40.0 / math.cos(math.radians(degrees)) ** 1.5
    found = matcher.views(Place(1.0, (u, camera.cy), width))
    tried = torch.tensor([40 / config.step, 40, 40 * config.step])
    assert len(found) and (found.widths[:, None] - tried).abs().amin(1).max() < 1e-3


def noise_templates(random: torch.Generator) -> Templates:
    count, channels, cells = 150, 32, 8
    kernels = torch.randn(count, channels, cells, cells, generator=random)
    kernels = torch.cat([kernels, torch.zeros(count, 3, cells, cells)], 1)
    shares, basis = torch.full((count, cells, cells), 1 / cells**2), torch.eye(channels)
    turns, boxes = torch.eye(3).expand(count, 3, 3), torch.zeros(count, 4)
    return Templates(turns, kernels / cells**2, shares, basis, boxes)


def noise_level(width: float, rows: int, columns: int, random: torch.Generator) -> Level:
    noise = torch.randn(32, rows, columns, generator=random)
    features, colours = functional.normalize(noise, dim=0), torch.zeros(3, rows, columns)
    return Level(width, 64 / width, 0.0, 0.0, features, colours)


def test_small_objects_are_not_found_by_chance() -> None:
    """In noise the many places of a small object are no better than the few of a large one."""
    random = torch.Generator().manual_seed(0)
    templates = noise_templates(random)
    finder = PlaceFinder(templates, replace(MatchConfig(), places=20), 0.0)
    for width, rows, columns in ((64.0, 60, 80), (256.0, 15, 20)):
        finder.add(noise_level(width, rows, columns, random))
    wide = sum(place.width > 100 for place in finder.places(20))
    assert 4 <= wide <= 16


@pytest.mark.parametrize("rows, columns", [((0, 4), (0, 8)), ((4, 8), (0, 8)), ((0, 8), (4, 8))])
def test_a_half_stands_out_more_than_the_whole_where_the_other_half_is_hidden(
    rows: tuple[int, int], columns: tuple[int, int]
) -> None:
    random = torch.Generator().manual_seed(1)
    templates, level = noise_templates(random), noise_level(64.0, 60, 80, random)
    part = (slice(*rows), slice(*columns))
    shown = functional.normalize(templates.kernels[7, :32], dim=0)[:, *part]
    level.features[:, 30:38, 50:58][:, *part] += 0.7 * shown
    finders = [PlaceFinder(templates, MatchConfig(), 0.0, parts) for parts in (WHOLE, HALVES)]
    for finder in finders:
        finder.add(level)
    whole, half = (finder.places(1)[0] for finder in finders)
    assert half.score > whole.score + 1
    assert math.dist(half.pixel, level.pixel(53.5, 33.5)) < 1
    assert all(not one.same(half, MatchConfig()) for one in finders[1].places(5, [half]))


@pytest.mark.parametrize("part", [*WHOLE, *HALVES])
def test_a_part_cut_out_scores_as_with_zeros_around_it(part: Part) -> None:
    random = torch.Generator().manual_seed(2)
    for k in (8, 9):
        kernels = torch.randn(5, 3, k, k, generator=random)
        maps = torch.randn(1, 3, 20, 30, generator=random)
        cut = _part_of(kernels, part)
        torch.testing.assert_close(
            _correlation(maps, cut, k), functional.conv2d(maps, cut.whole)[0], atol=1e-4, rtol=1e-4
        )
        row, column = (round(edge * k) for edge in (part[0], part[2]))
        assert (cut.whole[..., row, column] == kernels[..., row, column]).all()


def test_places_are_apart() -> None:
    config = MatchConfig()
    place = Place(1.0, (100.0, 50.0), 60.0)
    assert place.same(Place(0.5, (110.0, 60.0), 70.0), config)
    assert not place.same(Place(0.5, (130.0, 60.0), 70.0), config)
    assert not place.same(Place(0.5, (110.0, 60.0), 100.0), config)


def test_a_hidden_part_does_not_count() -> None:
    cells = torch.zeros(2, 9, 9)
    cells[:, 1:8, 1:8] = 1.0
    shares = cells / cells.sum((1, 2), keepdim=True)
    cosines = 0.8 * torch.ones(2, 9, 9)
    cosines[1, :, :4] = -0.5  # hidden from the left
    products = cosines * shares
    torch.testing.assert_close(seen_mean(products, shares, 1.0, 5), products.sum((1, 2)))
    assert float(products[1].sum()) < 0.4
    seen = seen_mean(products, shares, 0.3, 5)
    torch.testing.assert_close(seen, torch.tensor([0.8, 0.8]), atol=1e-5, rtol=0)
    # A twin in plain Python: cells in the order of their neighbourhoods' means, the last in part.
    random = torch.rand(1, 9, 9, generator=torch.Generator().manual_seed(0)) * shares[:1]
    ranked = []
    for row, column in itertools.product(range(9), range(9)):
        around = slice(max(row - 2, 0), row + 3), slice(max(column - 2, 0), column + 3)
        if shares[0, row, column] > 0:
            mean = float(random[0][around].sum() / shares[0][around].sum())
            ranked.append((mean, float(random[0, row, column]), float(shares[0, row, column])))
    total, left = 0.0, 0.5
    for _, product, share in sorted(ranked, reverse=True):
        total += product * min(1.0, max(0.0, left / share))
        left -= share
    assert float(seen_mean(random, shares[:1], 0.5, 5)) == pytest.approx(total / 0.5, rel=1e-4)


def test_spread_is_never_next_to_nothing(detector: PoseDetector) -> None:
    templates = detector.prepare().coarse
    windows = torch.randn(50, templates.rows.shape[1], generator=torch.Generator().manual_seed(0))
    mean, deviation = spread_of(windows, templates.rows, 0.2)
    scores = windows @ templates.rows.T
    torch.testing.assert_close(mean, scores.mean(0))
    assert (deviation >= scores.std(0)).all() and (deviation >= 0.2 * deviation.mean() - 1e-6).all()


def test_settings_are_checked() -> None:
    with pytest.raises(InputError, match="smaller first"):
        MatchConfig(widths=(0.5, 0.1))
    with pytest.raises(InputError, match="1 or more"):
        MatchConfig(places=0)
    with pytest.raises(InputError, match="shortlist 1 or more"):
        MatchConfig(shortlist=0)
    with pytest.raises(InputError, match="visible above 0"):
        MatchConfig(visible=0.0)
