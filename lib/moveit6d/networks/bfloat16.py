"""Chains of convolutions in bfloat16, prepared once for the processor that they run on.

Never trains.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache

import torch
from torch import Tensor, nn

from .blocks import Residual


class Bfloat16Convolutions(nn.Module):
    """Convolutions in bfloat16 between maps of float32.

    Batch normalisation must be folded in. Where torch has oneDNN's operators for it, the weights
    are laid out as the processor wants them once and not in every call, and ReLUs and sums are
    the convolutions' own: a quarter less time than without.
    """

    def __init__(self, convolutions: nn.Module, pack: bool = True) -> None:
        super().__init__()
        bfloat16 = convolutions.to(torch.bfloat16)
        self.convolutions = _packed(bfloat16) if pack and _can_pack() else bfloat16

    def forward(self, features: Tensor) -> Tensor:
        """Maps in and out as the convolutions have them, float32."""
        bfloat16: Tensor = self.convolutions(features.to(torch.bfloat16))
        return bfloat16.float()


def _can_pack() -> bool:
    """Whether torch has the operators, which its own compiler uses, and oneDNN this number."""
    operators = torch.ops.mkldnn
    named = ("_reorder_convolution_weight", "_convolution_pointwise", "_is_mkldnn_bf16_supported")
    if not all(hasattr(operators, name) for name in named):
        return False
    return bool(operators._is_mkldnn_bf16_supported())


def _packed(module: nn.Module) -> nn.Module:
    """The same module out of `_Packed` convolutions; other layers stay what they are."""
    if isinstance(module, Residual):
        return _PackedResidual(module)
    if isinstance(module, nn.Conv2d):
        return _Packed(module)
    if not isinstance(module, nn.Sequential):
        return module
    layers = [layer for layer in module if not isinstance(layer, nn.Identity)]
    if len(layers) == 2 and isinstance(layers[0], nn.Conv2d) and isinstance(layers[1], nn.ReLU):
        return _Packed(layers[0], "relu")
    return nn.Sequential(*[_packed(layer) for layer in layers])


class _Packed(nn.Module):
    """A convolution and what its answer goes through: `none` or `relu`."""

    weight: Tensor
    bias: Tensor

    def __init__(self, convolution: nn.Conv2d, after: str = "none") -> None:
        super().__init__()
        assert not isinstance(convolution.padding, str)
        self.how = (
            list(convolution.padding),
            list(convolution.stride),
            list(convolution.dilation),
            convolution.groups,
        )
        self.after = after
        weight = convolution.weight.detach()
        bias = weight.new_zeros(len(weight)) if convolution.bias is None else convolution.bias
        packed = torch.ops.mkldnn._reorder_convolution_weight(weight, *self.how)
        # Persistent, as a trace takes a network's state as its inputs: what oneDNN has laid out
        # cannot be a constant of its graph.
        self.register_buffer("bias", bias.detach())
        self.register_buffer("weight", packed)

    def forward(self, features: Tensor) -> Tensor:
        convolve, _ = _scripted()
        answer: Tensor = convolve(features, self.weight, self.bias, *self.how, self.after)
        return answer


class _PackedResidual(nn.Module):
    """A `Residual` whose sum is its second convolution's own."""

    def __init__(self, block: Residual) -> None:
        super().__init__()
        second = block.second[0]
        assert isinstance(second, nn.Conv2d)
        self.first, self.second = _packed(block.first), _Packed(second)

    def forward(self, features: Tensor) -> Tensor:
        _, convolve_and_add = _scripted()
        last, inner = self.second, self.first(features)
        answer: Tensor = convolve_and_add(inner, features, last.weight, last.bias, *last.how)
        return answer


@cache
def _scripted() -> tuple[Callable[..., Tensor], Callable[..., Tensor]]:
    """The two operators as TorchScript: a trace cannot hold their empty lists of numbers."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # as for the trace: what comes after it needs a compiler
        return torch.jit.script(_convolve), torch.jit.script(_convolve_and_add)


def _convolve(
    x: Tensor,
    weight: Tensor,
    bias: Tensor,
    padding: list[int],
    stride: list[int],
    dilation: list[int],
    groups: int,
    after: str,
) -> Tensor:
    answer: Tensor = torch.ops.mkldnn._convolution_pointwise(
        x, weight, bias, padding, stride, dilation, groups, after, [], ""
    )
    return answer


def _convolve_and_add(
    x: Tensor,
    other: Tensor,
    weight: Tensor,
    bias: Tensor,
    padding: list[int],
    stride: list[int],
    dilation: list[int],
    groups: int,
) -> Tensor:
    answer: Tensor = torch.ops.mkldnn._convolution_pointwise(
        x, other, weight, bias, padding, stride, dilation, groups, "add", 1.0, "relu", [], ""
    )
    return answer
