"""Networks to and from safetensors files whose header says how to rebuild them.

Never downloads and never runs anything found in a file.
"""

from __future__ import annotations

import dataclasses
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

import torch
from safetensors import SafetensorError, safe_open
from safetensors.torch import save

from ..checks import DAMAGE
from ..errors import WeightsError
from ..geometry.crop import Crop
from ..io import file_digest, replacing
from .kinds import KINDS, PoseNet

FORMAT = "moveit6d-1"
MOST_OF_A_SIZE = 4096  # channels or blocks that a network may have
WEIGHTS_NAME = "weights.safetensors"  # what a fit calls the file in its folder


@dataclass(frozen=True)
class LoadedNetwork:
    """A network in evaluation mode, the facts in its file's header, and the file's SHA-256."""

    network: PoseNet
    facts: dict[str, str]
    sha256: str


def save_network(network: PoseNet, path: Path, facts: dict[str, str] | None = None) -> None:
    """Write the weights and, in the header, format, kind, sizes and the given facts.

    Written under a temporary name first, so that a crash leaves no half file. `InputError` if it
    cannot be written.
    """
    kind = next(name for name, (cls, _) in KINDS.items() if isinstance(network, cls))
    header = {
        **(facts or {}),
        "format": FORMAT,
        "kind": kind,
        "config": json.dumps(dataclasses.asdict(network.config)),
    }
    tensors = {name: value.contiguous() for name, value in network.state_dict().items()}
    content = _in_order(save(tensors, header))
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def _in_order(content: bytes) -> bytes:
    """A safetensors file with its facts sorted, which come in another order each time.

    So the same network is the same file, and has the same SHA-256.
    """
    end = 8 + int.from_bytes(content[:8], "little")
    header = json.loads(content[8:end])
    header["__metadata__"] = dict(sorted(header["__metadata__"].items()))
    text = json.dumps(header, separators=(",", ":"), ensure_ascii=False).encode()
    text += b" " * (-len(text) % 8)  # tensors begin at a multiple of eight
    return len(text).to_bytes(8, "little") + text + content[end:]


def load_network(path: Path) -> LoadedNetwork:
    """Rebuild a network from its file; `WeightsError` says what is wrong with a foreign one."""
    path = Path(path)
    if not path.is_file():
        raise WeightsError(f"Weights file {path} does not exist.")
    try:
        with safe_open(path, "pt") as file:
            header = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, ValueError) as error:
        raise WeightsError(
            f"Weights file {path} is damaged or no safetensors file ({error}); copy it again."
        ) from None
    if header.get("format") != FORMAT or header.get("kind") not in KINDS:
        raise WeightsError(
            f"Weights file {path} was not written by this library (format "
            f"{header.get('format')!r}, expected {FORMAT!r})."
        )
    network_class, config_class = KINDS[header["kind"]]
    try:
        config = _config(header, config_class, sum(value.numel() for value in tensors.values()))
        network = network_class(config).float()  # whatever the program's default type is
        network.load_state_dict(tensors)
    except (*DAMAGE, RuntimeError, MemoryError) as error:
        reason = " ".join(str(error).split())[:160] or type(error).__name__
        raise WeightsError(
            f"Weights file {path} does not fit the network that its header names: {reason}"
        ) from None
    if not all(torch.isfinite(value).all() for value in tensors.values()):
        raise WeightsError(f"Weights file {path} holds numbers that are not finite.")
    facts = {k: v for k, v in header.items() if k not in ("format", "config")}
    return LoadedNetwork(network.eval(), facts, file_digest(path))


def _config(header: dict[str, str], config_class: type[Any], count: int) -> Any:
    """The sizes in a header; a `ValueError` where they are more than the file's numbers can fill.

    Looked at before the network is made: a header of a few bytes can ask for all of the memory.
    """
    values = json.loads(header["config"])
    if not isinstance(values, dict):
        raise ValueError("its config is no object")
    for name, value in values.items():
        for one in value if isinstance(value, list) else [value]:
            if isinstance(one, bool | str):
                continue
            if not isinstance(one, int | float) or not 0 <= one <= min(count, MOST_OF_A_SIZE):
                raise ValueError(f"its {name} is {str(value)[:40]}")
    config = config_class(
        **{name: tuple(v) if isinstance(v, list) else v for name, v in values.items()}
    )
    if config.crop not in get_args(Crop):
        raise ValueError(f"unknown crop {config.crop!r}")
    return config


def begin_from(network: PoseNet, path: Path) -> None:
    """Give a network the weights of a file, of a network of the same sizes or a shallower one.

    What it has beyond that (`CorrelationConfig.extra_blocks`) stays as it is, which is an identity
    in a new network; a head that was fitted for searches is left out. What it is shown
    (`use_depth`, `crop`) may differ. Raises `WeightsError` if the sizes do not fit.
    """
    known = load_network(path).network
    fits = type(known) is type(network)
    if fits:
        mine, theirs = network.state_dict(), _without_search_head(known, network)
        new = {name for name in mine.keys() - theirs.keys() if ".extra_blocks." not in name}
        fits = not new and not theirs.keys() - mine.keys()
        fits = fits and all(mine[name].shape == value.shape for name, value in theirs.items())
    if not fits:
        raise WeightsError(
            f"Weights file {path} holds a {type(known).__name__} of other sizes than the network "
            f"to train, a {type(network).__name__}; configure that as the file says: "
            f"{known.config}."
        )
    network.load_state_dict(theirs, strict=False)


def _without_search_head(known: PoseNet, network: PoseNet) -> dict[str, torch.Tensor]:
    """The known weights, without those of a search head that the network does not have."""
    has_one = getattr(network.config, "search_head", False)
    return {
        name: value
        for name, value in known.state_dict().items()
        if has_one or not name.startswith("search_head.")
    }
