"""The network of the loop answers as the trained one does, whatever the batch."""

import copy
import gc
import os
import pickle
from pathlib import Path

import pytest
import torch

from moveit6d.errors import InputError
from moveit6d.networks import bfloat16 as bfloat16_convolutions
from moveit6d.networks import inference
from moveit6d.networks.action_net import ActionNet
from moveit6d.networks.compact import CompactCorrelationNet
from moveit6d.networks.correlation import CorrelationNet
from moveit6d.networks.inference import TRACED, Compute, InferenceNetwork
from moveit6d.networks.weights_file import load_network
from moveit6d.policies import SHIPPED_WEIGHTS, load_policy
from tests.support.observations import an_observation


@pytest.mark.parametrize("kind", [CorrelationNet, ActionNet, CompactCorrelationNet])
def test_folded_and_traced_networks_answer_as_the_original(kind: type) -> None:
    torch.manual_seed(0)
    original = kind()
    for _ in range(3):  # running statistics that are not trivial
        original(an_observation(4))
    original.eval()
    fast = InferenceNetwork(original, compute="float32")
    for batch in (1, 2, TRACED + 1, 1):
        observation = an_observation(batch, seed=batch)
        with torch.no_grad():
            answer = original(observation)
        expected = answer[0] if isinstance(answer, tuple) else answer.prediction
        found = fast(observation)
        for name in ("logits", "delta", "confidence", "attention", "information"):
            wanted = getattr(expected, name)
            if wanted is None:
                assert getattr(found, name) is None
            else:
                torch.testing.assert_close(getattr(found, name), wanted, atol=1e-3, rtol=1e-3)
    # The original is a copy's template only: it can be trained on.
    assert any(isinstance(module, torch.nn.BatchNorm2d) for module in original.modules())
    assert all(parameter.requires_grad for parameter in original.parameters())


@pytest.mark.parametrize("batch", [1, 2, TRACED, TRACED + 3])
@pytest.mark.parametrize("packed", [True, False])
def test_bfloat16_moves_the_shipped_networks_answers_by_hundredths(
    packed: bool, batch: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not packed:
        monkeypatch.setattr(bfloat16_convolutions, "_can_pack", lambda: False)
    network = load_network(SHIPPED_WEIGHTS).network
    exact = InferenceNetwork(network, compute="float32")
    bfloat16 = InferenceNetwork(network, compute="bfloat16")
    observation = an_observation(batch, seed=4)
    wanted, found = exact(observation), bfloat16(observation)
    assert wanted.delta is not None and found.delta is not None
    off = (found.delta - wanted.delta).abs()
    assert 0 < float(off.max()) < 0.5
    assert float(off.median()) < 0.05
    torch.testing.assert_close(found.confidence, wanted.confidence, atol=0.05, rtol=0)
    assert found.delta.dtype is torch.float32


@pytest.mark.parametrize("amx", [True, False])
def test_auto_is_bfloat16_where_the_processor_has_amx(
    amx: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": amx, "avx2": True})
    assert inference.is_bfloat16_fast() is amx
    assert InferenceNetwork(CorrelationNet()).is_bfloat16 is amx
    assert InferenceNetwork(CorrelationNet(), compute="bfloat16").is_bfloat16
    assert not InferenceNetwork(CorrelationNet(), compute="float32").is_bfloat16


def test_capabilities_that_torch_does_not_list_are_not_there(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"architecture": "aarch64"})
    assert not inference.is_bfloat16_fast()
    monkeypatch.delattr(torch.cpu, "get_capabilities")  # as in older versions of torch
    assert not inference.is_bfloat16_fast()


@pytest.mark.parametrize("compute", ["float32", "bfloat16"])
def test_a_network_that_has_run_can_be_pickled_and_copied(compute: Compute) -> None:
    torch.manual_seed(0)
    observation = an_observation(1)
    network = InferenceNetwork(CompactCorrelationNet().eval(), compute)
    expected = network(observation)
    for other in (pickle.loads(pickle.dumps(network)), copy.deepcopy(network)):
        found = other(observation)
        assert other.is_bfloat16 == network.is_bfloat16
        torch.testing.assert_close(found.logits, expected.logits)
        torch.testing.assert_close(found.delta, expected.delta)


@pytest.mark.parametrize("compute", ["fp16", None])
def test_numbers_that_there_are_not_are_said(compute: Compute) -> None:
    with pytest.raises(InputError, match="must be one of 'auto', 'float32', 'bfloat16'"):
        InferenceNetwork(ActionNet(), compute)
    with pytest.raises(InputError, match="must be one of 'auto', 'float32', 'bfloat16'"):
        load_policy(compute=compute)


def test_a_device_that_is_not_there_is_said() -> None:
    with pytest.raises(InputError, match=r"cannot run on device 'xpu'.*choose 'cpu'"):
        InferenceNetwork(CorrelationNet(), device="xpu")


@pytest.mark.skipif(not torch.cuda.is_available(), reason="needs a GPU")
@pytest.mark.parametrize("compute", ["float32", "bfloat16"])
def test_a_gpu_answers_as_the_cpu_does(compute: Compute) -> None:
    torch.manual_seed(0)
    network = CorrelationNet().eval()
    for size in (1, 8):
        observation = an_observation(size)
        here = InferenceNetwork(network, compute)(observation)
        there = InferenceNetwork(network, compute, "cuda")(observation)
        assert there.delta is not None and here.delta is not None
        assert there.delta.device.type == "cpu"
        assert (there.delta - here.delta).abs().max() < (0.02 if compute == "float32" else 0.5)


@pytest.mark.skipif(not Path("/proc/self/statm").exists(), reason="reads Linux's /proc")
def test_networks_that_are_dropped_leave_no_memory() -> None:
    """Each trace of torch.jit's would stay for as long as the process lives: 15 MB."""
    network = load_network(SHIPPED_WEIGHTS).network
    seen = an_observation(1)

    def megabytes() -> float:
        gc.collect()
        return (
            int(Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGESIZE") / 1e6
        )

    for number in range(14):
        InferenceNetwork(network, compute="float32")(seen)
        if number == 3:
            before = megabytes()
    assert megabytes() - before < 40
