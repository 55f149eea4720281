"""Hands and cards: as often as stated, their tips in the patch, their arms out of it."""

from itertools import pairwise

import numpy as np
import pytest
import torch

from moveit6d.geometry.crop import OBJECT_SIZE
from moveit6d.synthesis.augmentation.hands import WIDTH, HandConfig, Hands, ProceduralHands
from moveit6d.synthesis.augmentation.lights import LightConfig
from moveit6d.synthesis.objects.occluders import hand
from tests.support.pairs import photos, rng

LIGHTS = LightConfig()


def some_hands(config: HandConfig, seed: int = 0) -> Hands:
    random = np.random.default_rng(seed)
    return Hands(config, ProceduralHands(config, photos(), random), LIGHTS, rng(seed))


def test_they_are_there_as_often_as_stated() -> None:
    hands = some_hands(HandConfig(probability=0.25, pool_size=3))
    chosen = [len(hands.draw(40, torch.full((40,), 5.0))[0]) for _ in range(3)]
    assert sum(chosen) / 120 == pytest.approx(0.25, abs=0.1)
    nobody, layers = some_hands(HandConfig(probability=0.0)).draw(40, torch.full((40,), 5.0))
    assert len(nobody) == 0 and layers.shape == (0, 4, 128, 128)


def test_a_few_are_kept_and_renewed() -> None:
    config = HandConfig(probability=1.0, pool_size=5, renew_every=2)
    hands = ProceduralHands(config, photos(), np.random.default_rng(0))
    seen = []
    for _ in range(5):
        hands._renew()
        seen.append(list(hands.kept))
    assert [len(kept) for kept in seen] == [4, 5, 5, 5, 5]
    new = [len(set(map(id, b)) - set(map(id, a))) for a, b in pairwise(seen)]
    assert new[0] == 1 and sum(new[1:]) in (1, 2)


def test_fingertips_are_in_the_patch_and_arms_lead_outward() -> None:
    config = HandConfig(probability=1.0, width=(40.0, 60.0), extent=0.75)
    one = hand(np.random.default_rng(0))
    distance = torch.full((200,), 5.0, dtype=torch.float64)
    tips = torch.from_numpy(one.tip).expand(200, 3)
    reaching = torch.ones(200, dtype=torch.bool)
    poses = some_hands(config)._poses(tips, reaching, OBJECT_SIZE * distance)
    focal = 5.0 * OBJECT_SIZE

    def pixels(point: np.ndarray) -> torch.Tensor:
        seen = (poses.rotation @ torch.tensor(point)[:, None])[..., 0] + poses.translation
        return focal * seen[:, :2] / seen[:, 2:]

    tip, wrist = pixels(one.tip), pixels(one.tip + 0.2 * np.array([0.0, -1.0, 0.0]))
    assert tip.abs().max() <= 0.75 * 64 + 1e-6
    along = wrist - tip
    outward = (along * tip).sum(1) / (along.norm(dim=1) * tip.norm(dim=1))
    assert (outward > np.cos(1.3)).float().mean() > 0.95
    depth = (poses.rotation @ torch.tensor(one.tip)[:, None])[:, 2, 0] + poses.translation[:, 2]
    width = focal * WIDTH / depth
    assert width.min() >= 40 - 1e-6 and width.max() <= 60 + 1e-6


def test_layers_show_lit_skin_that_reaches_the_border() -> None:
    hands = some_hands(
        HandConfig(probability=1.0, card_probability=0.0, width=(50.0, 80.0), pool_size=3)
    )
    chosen, layers = hands.draw(12, torch.full((12,), 6.0))
    assert chosen.tolist() == list(range(12))
    mask = layers[:, 3] > 0.5
    border = torch.cat([mask[:, 0], mask[:, -1], mask[:, :, 0], mask[:, :, -1]], 1)
    assert (border.any(1) & mask.flatten(1).any(1)).float().mean() > 0.8
    assert (layers[:, :3] * (1 - layers[:, 3:])).abs().max() == 0
    assert layers[:, :3].flatten(1).amax(1).min() > 0.05
