"""The network of the loop answers as the trained one does, whatever the batch."""

import pytest
import torch

from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.correlation import CorrelationNet
from moveit6d.networks.inference import TRACED, InferenceNetwork
from tests.support.observations import an_observation


@pytest.mark.parametrize("kind", [CorrelationNet, ActionNet])
def test_folded_and_traced_networks_answer_as_the_original(kind: type) -> None:
    torch.manual_seed(0)
    original = kind()
    for _ in range(3):  # running statistics that are not trivial
        original(an_observation(4))
    original.eval()
    fast = InferenceNetwork(original)
    for batch in (1, 2, TRACED + 1, 1):
        seen = an_observation(batch, seed=batch)
        with torch.no_grad():
            answer = original(seen)
        expected = answer[0] if isinstance(answer, tuple) else answer.decision
        found = fast(seen)
        for name in ("logits", "counts", "confidence", "attention"):
            wanted = getattr(expected, name)
            if wanted is None:
                assert getattr(found, name) is None
            else:
                torch.testing.assert_close(getattr(found, name), wanted, atol=1e-3, rtol=1e-3)
    # The original is a copy's template only: it can be trained on.
    assert any(isinstance(module, torch.nn.BatchNorm2d) for module in original.modules())
    assert all(parameter.requires_grad for parameter in original.parameters())
