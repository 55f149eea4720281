"""Chains of convolutions in bfloat16, packed or not, answer as plain ones do."""

import copy

import pytest
import torch
from torch import nn

from moveit6d.networks import bfloat16
from moveit6d.networks.bfloat16 import Bfloat16Convolutions
from moveit6d.networks.blocks import Residual, conv_block, with_extra_blocks
from moveit6d.networks.inference import folded


def _chain() -> nn.Sequential:
    """A chain with batch normalisation of non-trivial statistics folded in."""
    torch.manual_seed(0)
    chain = with_extra_blocks(
        [conv_block(5, 12, 2, 5), Residual(12)], 12, 1, [nn.Conv2d(12, 8, 1, bias=False)]
    )
    for module in chain.modules():
        if isinstance(module, nn.BatchNorm2d):
            nn.init.normal_(module.weight)
            nn.init.normal_(module.bias)
            nn.init.normal_(module.running_mean)
            nn.init.uniform_(module.running_var, 0.5, 2.0)
    return folded(chain)


@pytest.mark.parametrize("can_pack", [True, False])
def test_a_bfloat16_chain_answers_within_its_digits(
    can_pack: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if can_pack and not bfloat16._can_pack():
        pytest.skip("this processor or torch cannot compute with packed bfloat16")
    monkeypatch.setattr(bfloat16, "_can_pack", lambda: can_pack)
    chain = _chain()
    fast = Bfloat16Convolutions(copy.deepcopy(chain)).eval()
    packed = [m for m in fast.modules() if isinstance(m, bfloat16._Packed)]
    # Stem, the residual's two, two more of `deepened`, and the 1 × 1 at the end.
    assert len(packed) == (6 if can_pack else 0)
    features = torch.randn(2, 5, 32, 32)
    wanted = chain(features)
    for run in (fast, torch.jit.freeze(torch.jit.trace(fast, features, check_trace=False))):
        found = run(features)
        assert found.dtype is torch.float32
        assert float((found - wanted).abs().mean()) < 0.01 * float(wanted.abs().mean())


def test_torch_without_the_operators_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    class Nothing:
        pass

    monkeypatch.setattr(torch.ops, "mkldnn", Nothing())
    assert not bfloat16._can_pack()
