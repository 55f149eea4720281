"""Training pairs: truth fits picture, seeds repeat, augmentation keeps to its shares."""

import numpy as np
import pytest
import torch

from moveit6d.geometry.mesh import Mesh
from moveit6d.networks.least_squares import cell_pixels, move_points, project_points, surface_points
from moveit6d.synthesis.augment import AugmentConfig, Dice, cut_border, occlude
from moveit6d.synthesis.backgrounds import procedural_photo
from moveit6d.synthesis.pairs import PairConfig, PairGenerator, TrainingBatch
from moveit6d.synthesis.shapes import random_object


@pytest.fixture(scope="module")
def generator_parts() -> tuple[list[Mesh], list[np.ndarray]]:
    random = np.random.default_rng(0)
    photos = [procedural_photo(random, (160, 200)) for _ in range(4)]
    return [random_object(random, photos) for _ in range(3)], photos


def a_batch(parts: tuple[list[Mesh], list[np.ndarray]], seed: int = 0) -> TrainingBatch:
    return PairGenerator(*parts, PairConfig(), seed).batch(8)


def test_shapes_and_ranges(generator_parts: tuple[list[Mesh], list[np.ndarray]]) -> None:
    batch = a_batch(generator_parts)
    seen = batch.observation
    assert seen.image.shape == (8, 3, 128, 128) and seen.depth.shape == (8, 1, 128, 128)
    for picture in (seen.image, seen.rendering):
        assert picture.min() >= 0 and picture.max() <= 1 and torch.isfinite(picture).all()
    assert seen.depth.abs().max() < 0.6  # inside the sphere
    assert (seen.mask.flatten(1).mean(1) > 0.01).all()
    assert (batch.visible <= batch.true_mask).all()


def test_the_same_seed_gives_the_same_pairs_and_another_one_others(
    generator_parts: tuple[list[Mesh], list[np.ndarray]],
) -> None:
    first, again = a_batch(generator_parts), a_batch(generator_parts)
    assert torch.equal(first.observation.image, again.observation.image)
    assert torch.equal(first.counts, again.counts)
    assert not torch.equal(a_batch(generator_parts, 1).counts, first.counts)


def test_the_counts_take_the_rendering_to_the_observed_object(
    generator_parts: tuple[list[Mesh], list[np.ndarray]],
) -> None:
    """Surface points, moved by the counts, land on the true pose's surface where it shows."""
    batch = PairGenerator(*generator_parts, PairConfig(), 3).batch(8, "all_small")
    seen = batch.observation
    pixels = cell_pixels(4)
    moved = move_points(
        surface_points(seen.depth, seen.distance, pixels), seen.distance, batch.counts
    )
    on_object = seen.mask[:, 0, pixels[:, 1], pixels[:, 0]] > 0
    goal = project_points(moved, seen.distance).round().long().clamp(0, 127)
    sample = torch.arange(8)[:, None]
    depth = batch.true_depth[sample, 0, goal[..., 1], goal[..., 0]] + seen.distance[:, None]
    off = (depth - moved[..., 2]).abs()[on_object]
    assert (off < 0.03).float().mean() > 0.85  # the rest turned away or lies on the outline


def occluded_share(share: float) -> float:
    dice = Dice(torch.Generator().manual_seed(0))
    config = AugmentConfig(occluded=share, occluder_scale=(0.6, 0.75), photo_occluder=1.0)
    gray = torch.full((200, 3, 32, 32), 0.5)
    things = torch.ones(200, 4, 32, 32)
    _, covered = occlude(gray.clone(), things, gray, config, dice)
    return float((covered.flatten(1).amax(1) > 0.5).float().mean())


def test_occlusion_happens_as_often_as_stated() -> None:
    assert occluded_share(0.0) == 0.0
    # Some occluders land outside of the patch or are cut to almost nothing.
    assert 0.4 < occluded_share(0.55) <= 0.6
    assert occluded_share(1.0) > 0.85


def test_borders_are_black_and_known() -> None:
    dice = Dice(torch.Generator().manual_seed(0))
    picture, border = cut_border(torch.ones(300, 3, 32, 32), AugmentConfig(border=0.3), dice)
    assert torch.equal(picture[:, :1], 1 - border)
    share = float((border.flatten(1).amax(1) > 0).float().mean())
    assert 0.2 < share < 0.4
