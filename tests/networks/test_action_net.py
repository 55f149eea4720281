"""The paper's network: shapes, attention, the ablation without depth, and that it can learn."""

import torch

from moveit6d.networks.action_net import ActionConfig, ActionNet
from tests.support.observations import an_observation


def test_shapes_and_attention() -> None:
    prediction, logit = ActionNet().eval()(an_observation(3))
    assert prediction.logits.shape == (3, 13) and logit.shape == (3,)
    assert prediction.delta is None
    assert prediction.attention is not None and prediction.attention.shape == (3, 1, 8, 8)
    assert prediction.attention.min() >= 0 and prediction.attention.max() <= 1


def test_without_depth_there_are_seven_channels() -> None:
    network = ActionNet(ActionConfig(use_depth=False))
    assert network.embed[0][0].weight.shape[1] == 7
    assert ActionNet().embed[0][0].weight.shape[1] == 8
    assert an_observation(1).channels(False).shape == (1, 7, 128, 128)


def test_it_can_tell_two_observations_apart() -> None:
    torch.manual_seed(0)
    network = ActionNet(ActionConfig(channels=(8, 8, 16, 16), hidden=32))
    optimizer = torch.optim.Adam(network.parameters(), 3e-3)
    observation, target = an_observation(2), torch.tensor([3, 12])
    for _ in range(40):
        loss = torch.nn.functional.cross_entropy(network(observation)[0].logits, target)
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
    assert loss.item() < 0.1


def test_the_confidence_is_learnt_beside_the_actions_not_with_them() -> None:
    """Its logit moves the weights of output 13 alone."""
    torch.manual_seed(0)
    network = ActionNet(ActionConfig(channels=(8, 8, 16, 16), hidden=32))
    prediction, logit = network(an_observation(2))
    assert torch.equal(prediction.confidence, torch.sigmoid(logit))
    logit.square().sum().backward()
    last = network.classifier[-1]
    assert last.weight.grad[13].abs().max() > 0 and last.bias.grad[13] != 0
    assert last.weight.grad[:13].abs().max() == 0 and last.bias.grad[:13].abs().max() == 0
    trained = [name for name, p in network.named_parameters() if p.grad is not None]
    assert trained == ["classifier.2.weight", "classifier.2.bias"]
