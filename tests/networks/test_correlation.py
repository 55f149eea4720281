"""The correlation network: shapes, batches, gradients of the first steps."""

import torch

from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
from moveit6d.networks.matching import correlate
from moveit6d.observation import Observation
from tests.support.observations import an_observation


def test_offsets_follow_the_order_of_the_windows() -> None:
    """A picture moved one cell to the right correlates best at offset (1, 0)."""
    network = CorrelationNet()
    generator = torch.Generator().manual_seed(0)
    render = torch.nn.functional.normalize(torch.randn(1, 64, 16, 16, generator=generator), dim=1)
    moved = torch.roll(render, 1, dims=3)
    best = correlate(render, moved, network.coarse_index, 4).argmax(1)[0, 4:12, 4:11]
    assert (network.offsets[best] == torch.tensor([1.0, 0.0])).all()


def test_answers_have_the_stated_shapes_and_are_finite() -> None:
    network = CorrelationNet().eval()
    with torch.no_grad():
        output = network(an_observation(2))
    prediction = output.prediction
    assert prediction.logits.shape == (2, 13) and prediction.confidence.shape == (2,)
    assert prediction.delta is not None and prediction.delta.shape == (2, 6)
    assert prediction.attention is not None and prediction.attention.shape == (2, 1, 16, 16)
    assert output.matching.shape == (2, 256, 81)
    assert output.fine.displacement.shape == (2, 2, 32, 32)
    assert all(
        torch.isfinite(v).all() for v in (prediction.logits, prediction.delta, output.matching)
    )


def test_a_batch_answers_as_its_parts_do() -> None:
    network = CorrelationNet().eval()
    both = an_observation(2)
    with torch.no_grad():
        together = network(both).prediction.logits
        for i in range(2):
            part = Observation(*(getattr(both, n)[i : i + 1] for n in both.__dataclass_fields__))
            torch.testing.assert_close(
                network(part).prediction.logits[0], together[i], atol=1e-4, rtol=0
            )


def test_an_empty_rendering_gives_finite_answers() -> None:
    observation = an_observation(1)
    zero = torch.zeros_like(observation.mask)
    empty = Observation(
        observation.image, observation.rendering * 0, zero, zero, observation.distance
    )
    with torch.no_grad():
        delta = CorrelationNet().eval()(empty).prediction.delta
    assert delta is not None and torch.isfinite(delta).all()


def test_in_the_first_steps_only_matching_reaches_the_encoder() -> None:
    network = CorrelationNet()
    output = network(an_observation(2), matching_only=True)
    delta = output.prediction.delta
    assert delta is not None
    delta.sum().backward()
    gradient = network.encode8[0][0].weight.grad
    assert gradient is None or gradient.abs().max() == 0
    network(an_observation(2), matching_only=True).matching.square().sum().backward()
    assert network.encode8[0][0].weight.grad.abs().max() > 0


def test_without_depth_the_depth_is_not_looked_at() -> None:
    network = CorrelationNet(CorrelationConfig(use_depth=False)).eval()
    observation = an_observation(1)
    other = Observation(
        observation.image,
        observation.rendering,
        observation.depth * 0.3,
        observation.mask,
        observation.distance,
    )
    with torch.no_grad():
        assert torch.equal(network(observation).prediction.logits, network(other).prediction.logits)


def test_the_solution_has_all_its_digits_within_autocast() -> None:
    torch.manual_seed(0)
    network, seen = CorrelationNet().eval(), an_observation(2)
    with torch.no_grad():
        cells = network(seen).fine
        solved = network._solve(seen, seen.depth, cells)
        with torch.autocast("cpu", torch.bfloat16):
            assert torch.equal(network._solve(seen, seen.depth, cells), solved)


def test_where_the_correlation_points_has_all_its_digits_within_autocast() -> None:
    """It is a mean over offsets of up to four cells; with 8 bits it would be off by 0.1 pixels."""
    torch.manual_seed(0)
    network = CorrelationNet().eval()
    for parameter in network.answer.parameters():  # nothing is added to where it points
        torch.nn.init.zeros_(parameter)
    with torch.no_grad(), torch.autocast("cpu", torch.bfloat16):
        output = network(an_observation(2))
    expected = torch.softmax(output.matching.float(), -1) @ network.offsets * 8
    torch.testing.assert_close(
        output.coarse.displacement.flatten(2).mT, expected, atol=1e-4, rtol=0
    )
