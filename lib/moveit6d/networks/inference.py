"""A network as it runs in the loop: the same answers as in training, in less time.

Never trains.
"""

from __future__ import annotations

import copy
import warnings
from collections.abc import Callable, Mapping
from typing import Any, Literal, TypeVar, get_args

import torch
from torch import Tensor, nn
from torch.nn.utils import convert_conv2d_weight_memory_format
from torch.nn.utils.fusion import fuse_conv_bn_eval

from ..errors import InputError
from ..observation import Observation
from .action_net import ActionNet
from .bfloat16 import Bfloat16Convolutions
from .kinds import PoseNet
from .policy_output import PolicyOutput

# Batches up to this size are traced, one trace a size; in larger ones Python's share is small.
TRACED = 4

Answer = tuple[Tensor, ...]
Network = TypeVar("Network", bound=nn.Module)

# The numbers that convolutions compute with. Those with 8 instead of 24 bits take a third of the
# time where the processor multiplies matrices of them (AMX), and longer where it does not.
Compute = Literal["auto", "float32", "bfloat16"]


def is_bfloat16_fast() -> bool:
    """Whether this processor has AMX instructions for bfloat16; no if torch is too old to say."""
    capabilities: Mapping[str, Any] = getattr(torch.cpu, "get_capabilities", dict)()
    return bool(capabilities.get("amx_bf16", False))


def checked_device(device: str | torch.device) -> torch.device:
    """The device; `InputError` if this machine or this build of torch does not have it."""
    try:
        found = torch.device(device)
        torch.empty(1, device=found)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).splitlines()[0].rstrip(".")
        raise InputError(
            f"The network cannot run on device {str(device)!r}: {reason}; choose 'cpu'."
        ) from None
    return found


class InferenceNetwork:
    """Observation → prediction without gradients.

    Batch normalisation is folded into the convolutions, which compute with the numbers that
    `compute` names: `auto` is bfloat16 where `is_bfloat16_fast`. Small batches, where a third of
    the time would be Python's, run as a TorchScript trace of the same network. `device` is where it
    runs; observations come from the CPU and answers go back there. A copy, also one that was
    pickled, is made anew where it is unpickled. `InputError` for numbers and devices that there are
    not.
    """

    def __init__(
        self,
        network: PoseNet,
        compute: Compute = "auto",
        device: str | torch.device = "cpu",
    ) -> None:
        if compute not in get_args(Compute):
            known = ", ".join(repr(name) for name in get_args(Compute))
            raise InputError(f"compute is {compute!r}, must be one of {known}.")
        self._made_of = (network, compute, device)
        self.device = checked_device(device)
        network = folded(network).to(self.device)
        on_cpu = self.device.type == "cpu"
        auto = compute == "auto" and on_cpu and is_bfloat16_fast()
        self.is_bfloat16 = compute == "bfloat16" or auto
        if self.is_bfloat16:
            _to_bfloat16(network, pack=on_cpu)
        self.folded = _Plain(network).eval()
        self._traces: dict[tuple[int, ...], Callable[..., Answer]] = {}

    def __reduce__(self) -> tuple[Any, ...]:
        """What it is made of: traces and packed numbers belong to this process and processor."""
        return InferenceNetwork, self._made_of

    @torch.inference_mode()
    def __call__(self, observation: Observation) -> PolicyOutput:
        """Predict for a batch; the answer is on the CPU, wherever the network runs."""
        there = observation.to(self.device)
        tensors = (there.image, there.rendering, there.depth, there.mask, there.distance)
        run = self._trace(tensors) if len(observation) <= TRACED else self.folded
        logits, confidence, attention, *others = (part.cpu() for part in run(*tensors))
        delta, information = (*others, None, None)[:2]
        return PolicyOutput(logits, delta, confidence, attention, information)

    @torch.inference_mode()
    def descriptors(self, images: Tensor) -> Tensor:
        """What each cell of 8 × 8 pixels looks like: images (B, 3, H, W) → (B, C, H / 8, W / 8).

        On the CPU, as the answers are. `InputError` for a network that has no descriptors.
        """
        network = self.folded.network
        if isinstance(network, ActionNet):
            raise InputError(
                "This network has no descriptors to search an image with; use the method 'seeds', "
                "or weights of a correlation network."
            )
        return network.descriptors(images.to(self.device)).cpu()

    def _trace(self, tensors: tuple[Tensor, ...]) -> Callable[..., Answer]:
        shape = tuple(tensors[0].shape)
        if shape not in self._traces:
            self._traces[shape] = _traced(self.folded, tensors)
        return self._traces[shape]


def _traced(network: nn.Module, tensors: tuple[Tensor, ...]) -> Callable[..., Answer]:
    """The network's operators for tensors of these shapes, without Python between them.

    `torch.jit.trace` keeps what it traced as long as the process lives, 16 MB a network. The graph
    alone, in a compilation unit of its own, goes with the function.
    """
    from torch.jit import _trace as trace  # its names without an underscore keep the network alive

    with warnings.catch_warnings():
        # Shapes become constants: that is meant, there is a trace a size. Its successors
        # (torch.compile, torch.export) need a compiler at run time or gain nothing here.
        warnings.simplefilter("ignore")
        graph, _ = trace._get_trace_graph(network, tensors)  # type: ignore[no-untyped-call]
    # The graph takes the network's tensors after the given ones, each once.
    state = list(trace._unique_state_dict(network, keep_vars=True).values())  # type: ignore[no-untyped-call]
    run = torch._C._create_function_from_graph("network", graph)
    return lambda *given: run(*given, *state)


class _Plain(nn.Module):
    """Tensors in and out, as a trace needs it: logits, confidence and attention.

    After them a delta and its information, if the network answers these.
    """

    def __init__(self, network: PoseNet) -> None:
        super().__init__()
        self.network = network

    def forward(
        self, image: Tensor, rendering: Tensor, depth: Tensor, mask: Tensor, distance: Tensor
    ) -> Answer:
        observation = Observation(image, rendering, depth, mask, distance)
        answer = self.network(observation)
        prediction = answer[0] if isinstance(self.network, ActionNet) else answer.prediction
        parts = (prediction.logits, prediction.confidence, prediction.attention)
        others = (prediction.delta, prediction.information)
        return (*parts, *(one for one in others if one is not None))


def _to_bfloat16(network: nn.Module, pack: bool) -> None:
    """Replace the chains of convolutions, and single ones but of 1 × 1, which take no time."""
    for name, part in network.named_children():
        kinds = {type(module) for module in part.modules()}
        is_chain = isinstance(part, nn.Sequential) and nn.Conv2d in kinds and nn.Linear not in kinds
        if is_chain or (isinstance(part, nn.Conv2d) and part.kernel_size != (1, 1)):
            setattr(network, name, Bfloat16Convolutions(part, pack))


def folded(network: Network) -> Network:
    """A copy in evaluation mode with batch normalisation folded into the convolutions."""
    network = copy.deepcopy(network).eval().requires_grad_(False)
    for module in network.modules():
        if isinstance(module, nn.Sequential):
            for i in range(len(module) - 1):
                convolution, norm = module[i], module[i + 1]
                if isinstance(convolution, nn.Conv2d) and isinstance(norm, nn.BatchNorm2d):
                    module[i] = fuse_conv_bn_eval(convolution, norm)
                    module[i + 1] = nn.Identity()
    convert_conv2d_weight_memory_format(network, torch.channels_last)
    return network
