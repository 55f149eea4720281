"""The contact sheet: four patches a pair, the truth where the object is."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from moveit6d.synthesis.training.contact_sheet import GAP, contact_sheet
from moveit6d.synthesis.training.pairs import PairConfig, PairGenerator, TrainingBatch
from tests.support.pairs import objects, photos


@pytest.fixture(scope="module")
def batch() -> TrainingBatch:
    return PairGenerator(list(objects()), list(photos()), PairConfig(), 0).batch(3, "all_large")


def cells(sheet: np.ndarray) -> list[np.ndarray]:
    """The four patches of the first pair, in [0, 1]."""
    row = sheet[GAP : GAP + 128, GAP : GAP + 512] / 255
    return [row[:, 128 * k : 128 * (k + 1)] for k in range(4)]


def test_size_and_grey_gaps(batch: TrainingBatch) -> None:
    sheet = contact_sheet(batch, across=2)
    assert sheet.shape == (2 * (128 + 2 * GAP), 2 * (512 + 2 * GAP), 3) and sheet.dtype == np.uint8
    assert (sheet[:GAP] == 128).all() and (sheet[128 + 2 * GAP :, 512 + 2 * GAP :] == 128).all()


def test_patches_are_observed_rendered_marked_and_masked(batch: TrainingBatch) -> None:
    observed, rendered, marked, mask = cells(contact_sheet(batch))
    image = batch.observation.image[0].permute(1, 2, 0).numpy()
    assert np.allclose(observed, image, atol=0.003)
    assert np.allclose(rendered, batch.observation.rendering[0].permute(1, 2, 0), atol=0.003)
    green = np.abs(marked - (0.2, 1.0, 0.3)).max(-1) < 0.01
    truth = batch.true_mask[0, 0].numpy() > 0.5
    assert green.sum() > 50 and not green[~truth].any(), "the outline lies on the object"
    neighbours = sum(np.roll(truth, (a, b), (0, 1)) for a in (-1, 0, 1) for b in (-1, 0, 1))
    assert (neighbours[green] < 9).all(), "at its edge"
    assert ((mask == 1).all(-1) == (batch.visible[0, 0].numpy() > 0.5)).all()
    assert (mask.max(-1) > 0).sum() == truth.sum()


def test_covered_parts_are_dark_red(batch: TrainingBatch) -> None:
    hidden = replace(batch, clear=torch.zeros_like(batch.clear))
    mask = cells(contact_sheet(hidden))[3]
    assert np.allclose(mask[batch.true_mask[0, 0].numpy() > 0.5], (0.55, 0.1, 0.1), atol=0.003)
