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
    shape_loss,
    view_loss,
    view_pictures,
)
from moveit6d.networks.correlation import CorrelationNet
from moveit6d.synthesis.augmentation.backgrounds import procedural_photo
from moveit6d.synthesis.objects.shapes import random_object
from moveit6d.synthesis.training.pairs import PairConfig, PairGenerator, TrainingBatch
from moveit6d.synthesis.training.views import ViewConfig


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
        clear=torch.ones_like(batch.clear),
    )
    truth = dense_truth(still, 8)
    assert (truth.displacement.abs() * truth.covered[..., None]).max() < 1e-3
    assert torch.equal(truth.visible, truth.covered)


def test_covered_cells_are_not_visible(batch: TrainingBatch) -> None:
    hidden = replace(batch, clear=torch.zeros_like(batch.clear))
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


def test_a_line_beside_the_middles_of_its_cells_counts(batch: TrainingBatch) -> None:
    """It has cells to learn from, and a pose that is wrong for it is not right."""
    mask = torch.zeros_like(batch.observation.mask)
    mask[:, :, 64, 10:118] = 1  # the middles of cells of 8 are rows 60 and 68
    seen = replace(batch.observation, mask=mask, depth=torch.zeros_like(mask))
    line = replace(batch, observation=seen, true_depth=seen.depth, true_mask=mask)
    assert (dense_truth(line, 8).covered.sum(1) == 14).all()
    off = line.delta.clone()
    off[:, 0] += 20
    assert (point_error(line, off) > RIGHT).all()


def test_a_pose_is_right_by_the_object_not_by_the_patch(batch: TrainingBatch) -> None:
    error = torch.full((len(batch.delta),), 1.3 * RIGHT)
    assert not is_right(batch, error).any()
    assert is_right(replace(batch, zoom=1.5 * batch.zoom), error).all()


def test_every_term_is_finite_has_a_weight_and_a_gradient(batch: TrainingBatch) -> None:
    network = CorrelationNet()
    output = network(batch.observation)
    terms, right = correlation_losses(output, batch, network.config.radius, LossWeights())
    weights = LossWeights()
    delta = output.prediction.delta
    assert delta is not None
    assert torch.equal(right, is_right(batch, point_error(batch, delta)))
    assert all(hasattr(weights, name) for name in terms)
    total = torch.stack([value * getattr(weights, name) for name, value in terms.items()]).sum()
    total.backward()
    assert torch.isfinite(total)
    missing = [n for n, p in network.named_parameters() if p.grad is None]
    assert missing == []


def with_views(share: float = 1.0) -> TrainingBatch:
    random = np.random.default_rng(0)
    photos = [procedural_photo(random, (160, 200)) for _ in range(3)]
    meshes = [random_object(random, photos) for _ in range(6)]
    config = replace(PairConfig(), views=ViewConfig(share=share))
    return PairGenerator(meshes, photos, config, 0).batch(6, "all_small")


def test_descriptors_that_know_the_view_cost_less_than_ones_that_do_not() -> None:
    views = with_views().views
    assert views is not None
    views = replace(views, visible=torch.ones_like(views.visible))
    temperature = torch.tensor(2.3)
    mesh = torch.arange(len(views.image))
    generator = torch.Generator().manual_seed(0)
    image, *templates = torch.randn(5, len(views.image), 32, 16, 16, generator=generator)
    # The right template has the picture's own descriptors, the others any.
    knowing = torch.cat([image, torch.stack([image, *templates[1:]], 1).flatten(0, 1)])
    lost = torch.cat([image, torch.stack(templates, 1).flatten(0, 1)])
    costs = [float(view_loss(d, views, mesh, temperature)) for d in (knowing, lost)]
    assert costs[0] < 0.1 and costs[1] > 2.0


def test_invisible_objects_teach_no_descriptors() -> None:
    views = with_views().views
    assert views is not None
    described = torch.randn(len(view_pictures(views)), 32, 16, 16, requires_grad=True)
    gone = replace(views, visible=torch.zeros_like(views.visible))
    loss = view_loss(described, gone, torch.arange(len(views.image)), torch.tensor(2.3))
    loss.backward()
    assert loss.item() == 0 and described.grad is not None and described.grad.abs().max() == 0


def test_far_and_absent_pairs_teach_no_pose_delta(batch: TrainingBatch) -> None:
    network = CorrelationNet().eval()
    radius = network.config.radius
    with torch.no_grad():
        output = network(batch.observation)
        far = replace(batch, near=torch.zeros_like(batch.near))
        absent = replace(far, present=torch.zeros_like(batch.present))
        batches = (batch, far, absent)
        terms = [correlation_losses(output, b, radius, LossWeights())[0] for b in batches]
    for name in ("solved", "delta", "points", "actions"):
        assert terms[0][name] > 0 and terms[1][name] == 0
    for name in ("matching", "coarse", "fine", "visibility", "confidence"):
        assert terms[1][name] > 0
    assert not is_right(absent, torch.zeros(len(batch.delta))).any()
    assert terms[2]["confidence"] > 0


def test_truth_and_errors_have_all_their_digits_within_autocast(batch: TrainingBatch) -> None:
    """Autocast's products of matrices would move each point by a fraction of a pixel."""
    fine, off = dense_truth(batch, 4), 0.9 * batch.delta
    error = point_error(batch, off)
    with torch.autocast("cpu", torch.bfloat16):
        rounded = dense_truth(batch, 4)
        assert torch.equal(point_error(batch, off), error)
    assert torch.equal(rounded.displacement, fine.displacement)
    assert torch.equal(rounded.visible, fine.visible)


def test_the_stated_precision_is_computed_in_float32(batch: TrainingBatch) -> None:
    """A network's answers are short numbers within autocast, the loss of them is not."""
    truth = dense_truth(batch, 4)
    cells = CorrelationNet().eval()(batch.observation).fine
    short = (
        2 * torch.randn(cells.shape.shape, generator=torch.Generator().manual_seed(0))
    ).bfloat16()
    expected = shape_loss(replace(cells, shape=short.float()), truth)
    assert torch.equal(shape_loss(replace(cells, shape=short), truth), expected)
