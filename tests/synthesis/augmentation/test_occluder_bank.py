"""The bank of occluders: it fills, stops, and its patches have the paper's sizes."""

import numpy as np
import pytest
import torch

from moveit6d.synthesis.augmentation.lights import LightConfig
from moveit6d.synthesis.augmentation.occluder_bank import BankConfig, OccluderBank
from moveit6d.synthesis.objects.object_set import MeshObjects
from tests.support.meshes import square
from tests.support.pairs import objects, preset, rng


def a_bank(config: BankConfig) -> OccluderBank:
    random = np.random.default_rng(0)
    meshes = MeshObjects(objects())
    return OccluderBank(meshes, config, LightConfig(), (3.0, 6.0), rng(), random)


def test_the_paper_s_bank() -> None:
    config = preset("paper").bank
    assert config.size == 20_000
    assert (config.crop_size, config.resized_to) == ((96.0, 128.0), (32.0, 64.0))


def test_it_grows_to_its_size_and_not_farther() -> None:
    bank = a_bank(BankConfig(size=20, new_per_batch=8))
    sizes = []
    for _ in range(4):
        bank.grow()
        sizes.append(bank.filled)
    assert sizes == [8, 16, 20, 20]
    assert (bank.patches.flatten(1).amax(1) > 0).float().mean() > 0.9


def test_drawn_patches_are_layers_in_the_middle_of_empty_ones() -> None:
    bank = a_bank(BankConfig(size=8, new_per_batch=8))
    bank.grow()
    layers = bank.draw(30)
    assert layers.shape == (30, 4, 128, 128) and layers.min() >= 0 and layers.max() <= 1
    outside = layers.clone()
    outside[..., 32:96, 32:96] = 0
    assert outside.max() == 0
    assert len(torch.unique(layers.flatten(1).sum(1))) > 4, "different ones"


def test_cuts_are_resized_to_32_to_64_pixels() -> None:
    """A sheet that fills each patch shows how large the cuts become."""
    config = preset("paper").bank
    bank = a_bank(config)
    sizes = torch.tensor([bank._cut(torch.ones(4, 128, 128)).shape[1:] for _ in range(300)])
    assert sizes.min() >= 32 and sizes.max() <= 64
    assert sizes.float().mean() == pytest.approx(48, abs=1.5)
    assert (sizes[:, 0] != sizes[:, 1]).float().mean() > 0.8, "height and width are drawn apart"


def test_cuts_keep_at_least_96_pixels() -> None:
    bank = a_bank(preset("paper").bank)
    dotted = torch.zeros(4, 128, 128)
    dotted[:, 40:88, 40:88] = 1  # the middle 48 are in every cut
    for _ in range(20):
        cut = bank._cut(dotted)[0]
        share = float(cut.mean()) * cut.numel() / (cut.shape[0] * cut.shape[1])
        assert 48 * 48 / 128**2 * 0.98 < share < 48 * 48 / 96**2 * 1.02


def test_other_meshes_than_the_trained_ones_can_fill_it() -> None:
    sheet = square(colors=np.tile(np.uint8([255, 0, 0]), (4, 1)))
    lights = LightConfig(unlit_probability=1.0)
    config = BankConfig(size=6, new_per_batch=6)
    random = np.random.default_rng(0)
    bank = OccluderBank(MeshObjects([sheet]), config, lights, (3.0, 6.0), rng(), random)
    bank.grow()
    red, green = bank.patches[:, 0].float(), bank.patches[:, 1].float()
    assert red.max() > 200 and green.max() == 0
