"""The compact network: its work, its descriptors, and that it learns."""

import pytest
import torch
from torch import nn

from moveit6d.networks.compact import CompactConfig, CompactCorrelationNet
from moveit6d.networks.inference import folded
from moveit6d.observation import GREY, Observation
from moveit6d.synthesis.training.pairs import PairConfig, PairGenerator
from tests.support.pairs import objects, photos


def some(batch: int = 2) -> Observation:
    generator = PairGenerator(list(objects()), list(photos()), PairConfig(), 0)
    return generator.batch(batch, "all_small").observation


def test_an_iteration_takes_at_most_0_16_giga_multiply_adds() -> None:
    network = CompactCorrelationNet().eval()
    work = []

    def count(module: nn.Module, _: object, output: torch.Tensor) -> None:
        assert isinstance(module, nn.Conv2d)
        pixels = output.shape[0] * output.shape[2] * output.shape[3]
        work.append(pixels * module.weight.numel())

    for module in network.modules():
        if isinstance(module, nn.Conv2d):
            module.register_forward_hook(count)
    with torch.inference_mode():
        network(some(1))
    assert 0.1e9 < sum(work) <= 0.16e9


def test_every_parameter_but_the_temperature_of_views_gets_a_gradient() -> None:
    network = CompactCorrelationNet()
    beside = torch.rand(2, 3, 128, 128)
    output = network(some(), beside=beside)
    assert output.described is not None and output.described.shape == (2, 32, 16, 16)
    prediction = output.prediction
    assert prediction.delta is not None
    total = output.matching.square().mean() + output.described.square().mean()
    for part in (output.coarse, output.fine):
        total = total + part.displacement.mean() + part.visibility.mean() + part.weight.mean()
    total = total + prediction.delta.square().mean() + prediction.logits.square().mean()
    (total + output.confidence_logit.mean() + output.fine.shape.square().mean()).backward()
    without = {name for name, p in network.named_parameters() if p.grad is None}
    assert without == {"view_temperature"}


def test_descriptors_of_a_picture_are_those_beside_a_batch() -> None:
    network = CompactCorrelationNet().eval()
    pictures = torch.rand(3, 3, 128, 128)
    with torch.inference_mode():
        beside = network(some(), beside=pictures).described
        alone = network.descriptors(pictures)
        wide = network.descriptors(torch.full((1, 3, 96, 160), GREY))
    assert beside is not None and torch.allclose(alone, beside, atol=1e-5)
    assert wide.shape == (1, 32, 12, 20)


def test_folding_the_normalisation_changes_nothing() -> None:
    network = CompactCorrelationNet(CompactConfig(use_depth=False)).eval()
    observation = some()
    with torch.inference_mode():
        before, after = network(observation), folded(network)(observation)
    assert before.prediction.delta is not None and after.prediction.delta is not None
    assert torch.allclose(before.prediction.delta, after.prediction.delta, atol=1e-3)
    assert before.prediction.confidence == pytest.approx(after.prediction.confidence, abs=1e-4)


def test_a_search_head_is_another_confidence_of_the_same_deltas() -> None:
    network = CompactCorrelationNet(CompactConfig(search_head=True)).eval()
    assert not any(one.requires_grad for one in network.search_head.parameters())
    with torch.no_grad():
        last = network.search_head[-1]
        assert isinstance(last, nn.Linear)
        last.weight.zero_()
        last.bias.fill_(0.5)
        seen = some()
        plain, searching = network(seen).prediction, network.for_search()(seen).prediction
    torch.testing.assert_close(searching.confidence, torch.full((2,), 0.5).sigmoid())
    assert (plain.confidence - searching.confidence).abs().max() > 0.01
    torch.testing.assert_close(plain.delta, searching.delta)
    assert not network.for_search().config.search_head and network.config.search_head
