"""Dihedral views of pairs: the truth still says where everything is, and eight of them are all."""

from dataclasses import replace

import pytest
import torch

from lightning_modules.losses import dense_truth
from moveit6d.errors import InputError
from moveit6d.geometry.crop import Crop
from moveit6d.synthesis.training.dihedral import dihedral_view
from moveit6d.synthesis.training.pairs import PairConfig, PairGenerator, TrainingBatch
from moveit6d.synthesis.training.views import ViewConfig
from tests.support.pairs import objects, photos


def pairs(config: PairConfig) -> TrainingBatch:
    return PairGenerator(list(objects()), list(photos()), config, 0).batch(6, "all_small")


@pytest.mark.parametrize("crop", ["look_at", "axis_parallel"])
@pytest.mark.parametrize("mirror", [False, True])
@pytest.mark.parametrize("quarters", [1, 2, 3])
def test_the_delta_still_takes_the_surface_to_where_it_shows(
    quarters: int, mirror: bool, crop: Crop
) -> None:
    batch = pairs(replace(PairConfig(), crop=crop))
    shown = dihedral_view(batch, quarters, mirror)
    before, after = (dense_truth(one, 2).visible.sum(1) for one in (batch, shown))
    # Cells do not sample the object at the same places, so that a few differ.
    assert (after - before).abs().sum() < 0.1 * before.sum()
    wrong = dense_truth(replace(shown, delta=batch.delta), 2).visible.sum(1)
    assert wrong.sum() < after.sum()


def test_four_quarters_and_two_mirrors_change_nothing() -> None:
    batch = pairs(PairConfig())
    turned = batch
    for _ in range(4):
        turned = dihedral_view(turned, 1, False)
    for other in (turned, dihedral_view(dihedral_view(batch, 0, True), 0, True)):
        assert torch.equal(other.observation.image, batch.observation.image)
        assert torch.equal(other.true_depth, batch.true_depth)
        assert torch.equal(other.delta, batch.delta)
        torch.testing.assert_close(other.rotation, batch.rotation)
        torch.testing.assert_close(other.direction, batch.direction)


def test_a_rolled_camera_sees_the_rotation_that_is_told() -> None:
    """After a quarter, what pointed right in the view points up: (x, y) comes to (y, -x)."""
    batch = pairs(PairConfig())
    turned = dihedral_view(batch, 1, False).rotation
    torch.testing.assert_close(turned[:, 0], batch.rotation[:, 1])
    torch.testing.assert_close(turned[:, 1], -batch.rotation[:, 0])
    mirrored = dihedral_view(batch, 0, True).rotation
    torch.testing.assert_close(torch.linalg.det(mirrored), torch.ones(6, dtype=mirrored.dtype))


def test_pairs_with_templates_are_refused() -> None:
    batch = pairs(replace(PairConfig(), views=ViewConfig(share=1.0)))
    with pytest.raises(InputError, match="templates"):
        dihedral_view(batch, 1, False)
