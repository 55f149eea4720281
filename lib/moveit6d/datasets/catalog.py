"""Any data set in a folder as a list of sequences, its format stated or recognised.

Never converts anything itself; each format has its own module.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from ..checks import reading
from ..errors import InputError
from ..io import read_json
from . import bop_sequences, laval, rbot, sequences, ycbv
from .sequences import Sequence

# What a folder made by this library says of itself: never the real data set's name alone.
SURROGATE = "surrogate.json"
# In the order in which they are tried: kind, what proves it, its reader, and what was looked for.
FORMATS: dict[str, tuple[Callable[[Path], bool], Callable[[Path], list[Sequence]], str]] = {
    "laval": (
        lambda path: any(map(laval.is_laval_sequence, (path, *_folders(path)))),
        laval.read_laval,
        "OBJECT_occlusion_0/poses.npy (Laval)",
    ),
    "ycbv": (ycbv.is_ycbv, ycbv.read_ycbv, "data/0048/000001-meta.mat (YCB-Video as published)"),
    "rbot": (rbot.is_rbot, rbot.read_rbot, "poses_first.txt (RBOT)"),
    "bop": (
        bop_sequences.is_bop,
        bop_sequences.read_bop_sequences,
        "models/models_info.json and SPLIT/000001/scene_gt.json (BOP)",
    ),
    "folders": (
        lambda path: any(map(sequences.is_sequence, (path, *_folders(path)))),
        sequences.read_sequences,
        "camera.json beside poses.csv and frames/ (sequence folders)",
    ),
}


def open_dataset(path: str | Path, kind: str | None = None) -> list[Sequence]:
    """The sequences at `path`: one an object and video, in the order of their names.

    `kind` is one of folders, bop, ycbv, laval, rbot, or None to recognise what lies there. Only
    poses are read; `Sequence.open` gives the images one after the other. `InputError` if nothing
    is found, with what was looked for.
    """
    path = Path(path)
    if not path.is_dir():
        raise InputError(f"{path} is not a folder; a data set was expected there.")
    if kind is None:
        kind = recognise(path)
    elif kind not in FORMATS:
        raise InputError(f"There is no kind of data set {kind!r}; choose one of {_kinds()}.")
    with reading(path, kind):
        return FORMATS[kind][1](path)


def recognise(path: str | Path) -> str:
    """Which kind of data set lies at `path`; `InputError` naming what was looked for."""
    path = Path(path)
    for kind, (is_there, _, _) in FORMATS.items():
        if is_there(path):
            return kind
    wanted = "; ".join(sign for _, _, sign in FORMATS.values())
    raise InputError(f"{path} holds no data set that is known; looked for {wanted}.")


def surrogate(path: str | Path) -> str:
    """What a made data set says of itself, "" for one without such a word.

    Figures on it must be labelled with these words.
    """
    place = Path(path) / SURROGATE
    return str(read_json(place).get("what", "surrogate")) if place.is_file() else ""


def _kinds() -> str:
    return ", ".join(sorted(FORMATS))


def _folders(path: Path) -> list[Path]:
    return sorted(place for place in path.iterdir() if place.is_dir())
