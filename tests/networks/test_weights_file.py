"""Weights files: there and back, and a sentence for every file that is not ours."""

import resource
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from moveit6d.errors import InputError, WeightsError
from moveit6d.networks.action_net import ActionConfig, ActionNet
from moveit6d.networks.compact import CompactConfig, CompactCorrelationNet
from moveit6d.networks.correlation import CorrelationConfig, CorrelationNet
from moveit6d.networks.weights_file import begin_from, load_network, save_network
from tests.support.observations import an_observation


@pytest.mark.parametrize("depth", [True, False])
def test_a_network_comes_back_as_it_was(tmp_path: Path, depth: bool) -> None:
    network = CorrelationNet(CorrelationConfig(channels=(8, 16, 24), use_depth=depth)).eval()
    save_network(network, tmp_path / "a.safetensors", {"licence": "Apache-2.0"})
    loaded = load_network(tmp_path / "a.safetensors")
    assert loaded.network.config == network.config
    assert loaded.facts == {"licence": "Apache-2.0", "kind": "correlation"}
    assert len(loaded.sha256) == 64
    with torch.no_grad():
        observation = an_observation(1)
        assert torch.equal(
            loaded.network(observation).prediction.logits, network(observation).prediction.logits
        )
    assert [path.name for path in tmp_path.iterdir()] == ["a.safetensors"]


def test_the_paper_s_network_comes_back_too(tmp_path: Path) -> None:
    network = ActionNet(ActionConfig(channels=(8, 8, 8, 8)))
    save_network(network, tmp_path / "b.safetensors")
    assert isinstance(load_network(tmp_path / "b.safetensors").network, ActionNet)


def test_the_same_network_is_the_same_file(tmp_path: Path) -> None:
    network = ActionNet(ActionConfig(channels=(8, 8, 8, 8)))
    facts = dict.fromkeys("zyxwvutsrq", "Größe")
    files = {tmp_path / f"{number}.safetensors" for number in range(4)}
    for file in files:
        save_network(network, file, facts)
    assert len({file.read_bytes() for file in files}) == 1
    loaded = load_network(files.pop())
    assert loaded.facts == {**facts, "kind": "action"}
    for name, value in network.state_dict().items():
        assert torch.equal(loaded.network.state_dict()[name], value)


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(WeightsError, match=r"no\.safetensors does not exist"):
        load_network(tmp_path / "no.safetensors")


def test_a_damaged_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "cut.safetensors"
    save_network(CorrelationNet(), path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(WeightsError, match="damaged"):
        load_network(path)


def test_a_foreign_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "foreign.safetensors"
    save_file({"weight": torch.zeros(3)}, path)
    with pytest.raises(WeightsError, match="not written by this library"):
        load_network(path)


def test_weights_that_do_not_fit_their_header_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "wrong.safetensors"
    header = {"format": "moveit6d-1", "kind": "correlation", "config": "{}"}
    save_file({"weight": torch.zeros(3)}, path, header)
    with pytest.raises(WeightsError, match="does not fit"):
        load_network(path)


def test_a_crop_that_nobody_knows_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "odd.safetensors"
    save_network(ActionNet(ActionConfig(crop="round")), path)  # type: ignore[arg-type]
    with pytest.raises(WeightsError, match="unknown crop 'round'"):
        load_network(path)


def test_weights_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    network = ActionNet(ActionConfig(channels=(8, 8, 8, 8)))
    network.classifier[0].weight.data[0, 0] = float("nan")
    save_network(network, tmp_path / "nan.safetensors")
    with pytest.raises(WeightsError, match="not finite"):
        load_network(tmp_path / "nan.safetensors")


def test_extra_blocks_begin_with_the_answers_of_the_shallower_network(tmp_path: Path) -> None:
    torch.manual_seed(0)
    shallow = CorrelationNet()
    for _ in range(3):  # running statistics that are not trivial
        shallow(an_observation(4))
    save_network(shallow, tmp_path / "shallow.safetensors")
    deep = CorrelationNet(CorrelationConfig(extra_blocks=(1, 2, 1)))
    begin_from(deep, tmp_path / "shallow.safetensors")
    assert sum(p.numel() for p in deep.parameters()) > 1.5 * sum(
        p.numel() for p in shallow.parameters()
    )
    observation = an_observation(2, seed=3)
    with torch.no_grad():
        wanted, found = shallow.eval()(observation), deep.eval()(observation)
    torch.testing.assert_close(found.prediction.delta, wanted.prediction.delta)
    torch.testing.assert_close(found.prediction.logits, wanted.prediction.logits)
    # Its new blocks learn: the gradient reaches what keeps them identities.
    answer = deep.train()(an_observation(4))
    answer.prediction.delta.square().sum().backward()
    new = {name: p for name, p in deep.named_parameters() if name.endswith("second.1.weight")}
    new = {name: p for name, p in new.items() if ".extra_blocks." in name}
    assert len(new) == 4
    assert all(p.grad is not None and bool(p.grad.abs().sum() > 0) for p in new.values())


def test_a_network_is_not_begun_from_weights_of_other_sizes(tmp_path: Path) -> None:
    path = tmp_path / "a.safetensors"
    save_network(CorrelationNet(CorrelationConfig(context=40)), path)
    with pytest.raises(WeightsError, match=r"other sizes .*CorrelationNet.*context=40"):
        begin_from(CorrelationNet(), path)
    with pytest.raises(WeightsError, match=r"a CorrelationNet of other sizes .* a ActionNet"):
        begin_from(ActionNet(), path)
    save_network(CorrelationNet(CorrelationConfig(extra_blocks=(1, 0, 0))), path)
    with pytest.raises(WeightsError, match="other sizes"):
        begin_from(CorrelationNet(), path)  # what a file has beyond the network is not dropped


def test_what_a_network_is_shown_may_differ_from_what_its_weights_were(tmp_path: Path) -> None:
    known = CorrelationNet()
    save_network(known, tmp_path / "a.safetensors")
    network = CorrelationNet(CorrelationConfig(use_depth=False))
    begin_from(network, tmp_path / "a.safetensors")
    assert not network.config.use_depth
    assert torch.equal(network.answer.weight, known.answer.weight)


def test_a_full_disk_is_a_sentence_and_keeps_the_older_file(tmp_path: Path) -> None:
    path, network = tmp_path / "a.safetensors", CorrelationNet(CorrelationConfig((8, 16, 24)))
    path.write_bytes(b"older")
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (5000, limit[1]))  # as far as a file can grow
    try:
        with pytest.raises(InputError, match=r"a\.safetensors cannot be written: "):
            save_network(network, path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert path.read_bytes() == b"older" and list(tmp_path.iterdir()) == [path]


def test_a_search_head_is_kept_in_the_file_and_left_out_of_a_training(tmp_path: Path) -> None:
    known = CompactCorrelationNet(CompactConfig(search_head=True))
    save_network(known, tmp_path / "a.safetensors")
    again = load_network(tmp_path / "a.safetensors").network
    assert isinstance(again, CompactCorrelationNet)
    for one, other in zip(
        known.search_head.parameters(), again.search_head.parameters(), strict=True
    ):
        assert torch.equal(one, other)
    network = CompactCorrelationNet()
    begin_from(network, tmp_path / "a.safetensors")
    assert torch.equal(network.answer.weight, known.answer.weight)
    assert not any(name.startswith("search_head") for name in network.state_dict())
