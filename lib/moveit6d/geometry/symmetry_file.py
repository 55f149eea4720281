"""Symmetries that stand beside a mesh file: BOP's models_info.json, or one object's entry of it.

Never guesses, but adds the products of those declared. For `can.glb` the entry is looked for in
`can.symmetry.json` (BOP's keys `symmetries_discrete` and `symmetries_continuous`, millimetres as in
BOP), and for `obj_000005.ply` in a `models_info.json` of the same folder too.
"""

from __future__ import annotations

import re
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from ..checks import mapping
from ..errors import InputError
from ..io import read_json, write_json
from .symmetry import Symmetries

KEYS = ("symmetries_discrete", "symmetries_continuous")


def symmetries_beside(mesh: Path) -> Symmetries:
    """The symmetries declared beside a mesh file, in its frame; none where nothing is declared."""
    own = mesh.with_suffix(".symmetry.json")
    if own.is_file():
        info = read_json(own)
        if not any(key in info for key in KEYS):
            raise InputError(
                f"{own} has neither {KEYS[0]} nor {KEYS[1]}; see docs/how-to/own-object.md."
            )
        return _declared(info, own)
    number = re.fullmatch(r"obj_(\d+)", mesh.stem)
    whole = mesh.with_name("models_info.json")
    if number and whole.is_file():
        info = read_json(whole).get(str(int(number[1]))) or {}
        return _declared(mapping(info, f"{whole}: object {int(number[1])}"), whole)
    return symmetries_beside(mesh.resolve()) if mesh.is_symlink() else Symmetries()


def write_symmetries(mesh: Path, symmetries: Symmetries) -> None:
    """Declare symmetries beside a mesh file, so that `symmetries_beside` finds them; none: no file.

    An older declaration is replaced.
    """
    own = mesh.with_suffix(".symmetry.json")
    if symmetries.is_trivial:
        own.unlink(missing_ok=True)
    else:
        write_json(own, symmetries.to_bop())


def _declared(info: dict[str, Any], path: Path) -> Symmetries:
    for key in info:
        if key.casefold().startswith("sym") and key not in KEYS:  # would be none without a word
            near = get_close_matches(key, KEYS, 1, 0)[0]
            raise InputError(f"{path}: there is no key {key!r}; did you mean {near!r}?")
    try:
        return Symmetries.from_bop(info).closed()
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
