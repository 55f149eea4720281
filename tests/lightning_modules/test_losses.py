"""Losses: their truth is right, perfect answers cost nothing, wrong ones cost more."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from lightning_modules.losses import (
    RIGHT,
    LossWeights,
    correlation_losses,
    dense_truth,
    is_right,
    matching_loss,
    point_error,
)
from moveit6d.networks.correlation import CorrelationNet
from moveit6d.synthesis.augmentation.backgrounds import procedural_photo
from moveit6d.synthesis.objects.shapes import random_object
from moveit6d.synthesis.training.pairs import PairConfig, PairGenerator, TrainingBatch


@pytest.fixture(scope="module")
def batch() -> TrainingBatch:
    random = np.random.default_rng(0)
    photos = [procedural_photo(random, (160, 200)) for _ in range(3)]
    meshes = [random_object(random, photos) for _ in range(2)]
    return PairGenerator(meshes, photos, PairConfig(), 0).batch(6, "all_small")


def test_no_counts_mean_no_displacement(batch: TrainingBatch) -> None:
    still = replace(
        batch,
        delta=torch.zeros_like(batch.delta),
        true_depth=batch.observation.depth,
        true_mask=batch.observation.mask,
        visible=batch.observation.mask,
    )
    truth = dense_truth(still, 8)
    assert (truth.displacement.abs() * truth.covered[..., None]).max() < 1e-3
    assert torch.equal(truth.visible, truth.covered)


def test_covered_cells_are_not_visible(batch: TrainingBatch) -> None:
    hidden = replace(batch, visible=torch.zeros_like(batch.visible))
    assert dense_truth(hidden, 4).visible.max() == 0


def test_matching_loss_is_least_at_the_true_displacement(batch: TrainingBatch) -> None:
    truth = dense_truth(batch, 8)
    radius, side = 4, 9
    cells = (truth.displacement / 8).round().long().clamp(-radius, radius)
    index = (cells[..., 1] + radius) * side + cells[..., 0] + radius
    right = torch.nn.functional.one_hot(index, side * side).float() * 6
    wrong = right.roll(5, -1)
    flat = torch.zeros_like(right)
    losses = [matching_loss(x, truth, radius).item() for x in (right, flat, wrong)]
    assert losses[0] < losses[1] < losses[2]
    assert losses[1] == pytest.approx(np.log(side * side), abs=1e-4)


def test_point_error_is_zero_at_the_truth_and_grows(batch: TrainingBatch) -> None:
    assert point_error(batch, batch.delta).max() < 2e-4
    off = batch.delta.clone()
    off[:, 2] += 1
    error = point_error(batch, off)
    # One pixel of diameter is a step in depth of distance / 91 diameters.
    expected = batch.observation.distance / (128 / 1.4)
    assert torch.allclose(error, expected, rtol=0.2)
    assert (point_error(batch, off) > RIGHT).any() or (expected < RIGHT).all()


def test_a_pose_is_right_by_the_object_not_by_the_patch(batch: TrainingBatch) -> None:
    error = torch.full((len(batch.delta),), 1.3 * RIGHT)
    assert not is_right(batch, error).any()
    assert is_right(replace(batch, zoom=1.5 * batch.zoom), error).all()


def test_every_term_is_finite_has_a_weight_and_a_gradient(batch: TrainingBatch) -> None:
    network = CorrelationNet()
    output = network(batch.observation)
    terms = correlation_losses(output, batch, network.config.radius, LossWeights())
    weights = LossWeights()
    assert all(hasattr(weights, name) for name in terms)
    total = torch.stack([value * getattr(weights, name) for name, value in terms.items()]).sum()
    total.backward()
    assert torch.isfinite(total)
    missing = [n for n, p in network.named_parameters() if p.grad is None]
    assert missing == []
