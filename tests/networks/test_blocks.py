"""Layers that the networks share, against plain sums."""

from __future__ import annotations

import pytest
import torch

from moveit6d.networks.blocks import Residual, attention_pool, conv_block, with_extra_blocks


@pytest.mark.parametrize(("stride", "kernel"), [(1, 3), (2, 3), (2, 5), (1, 1)])
def test_a_block_of_any_kernel_only_strides(stride: int, kernel: int) -> None:
    block = conv_block(3, 5, stride, kernel)
    found = block(torch.randn(2, 3, 16, 24))
    assert found.shape == (2, 5, 16 // stride, 24 // stride) and (found >= 0).all()


def test_a_residual_block_may_begin_as_an_identity() -> None:
    features = torch.rand(2, 4, 6, 6)
    assert torch.equal(Residual(4, identity=True).eval()(features), features)
    assert not torch.allclose(Residual(4).eval()(features), features)


def test_extra_blocks_change_neither_answers_nor_names() -> None:
    torch.manual_seed(0)
    shallow = with_extra_blocks([conv_block(3, 4)], 4, 0, [conv_block(4, 2)]).eval()
    deep = with_extra_blocks([conv_block(3, 4)], 4, 2, [conv_block(4, 2)]).eval()
    missing = deep.load_state_dict(shallow.state_dict(), strict=False)
    assert not missing.unexpected_keys
    assert all(key.startswith("extra_blocks") for key in missing.missing_keys)
    image = torch.randn(1, 3, 8, 8)
    torch.testing.assert_close(deep(image), shallow(image))


def test_attention_pooling_is_a_weighted_mean() -> None:
    features = torch.randn(2, 3, 4, 5)
    attention = torch.zeros(2, 1, 4, 5)
    attention[0, 0, 1, 2] = attention[0, 0, 3, 4] = 500.0
    found = attention_pool(features, attention)
    expected = (features[0, :, 1, 2] + features[0, :, 3, 4]) / 2
    torch.testing.assert_close(found[0], expected, atol=1e-5, rtol=1e-4)
    assert (found[1] == 0).all(), "nothing is looked at"
