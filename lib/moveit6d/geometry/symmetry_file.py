"""Symmetries that stand beside a mesh file: BOP's models_info.json, or one object's entry of it.

Never guesses. For `can.glb` the entry is looked for in `can.symmetry.json` (BOP's keys
`symmetries_discrete` and `symmetries_continuous`, millimetres as in BOP), and for `obj_000005.ply`
in a `models_info.json` of the same folder too.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

from ..errors import InputError
from .symmetry import Symmetries

KEYS = ("symmetries_discrete", "symmetries_continuous")


def symmetries_beside(mesh: Path) -> Symmetries:
    """The symmetries declared beside a mesh file, in its frame; none where nothing is declared."""
    own = mesh.with_suffix(".symmetry.json")
    if own.is_file():
        info = _object(own)
        if not any(key in info for key in KEYS):
            raise InputError(
                f"{own} has neither {KEYS[0]} nor {KEYS[1]}; see docs/how-to/own-object.md."
            )
        return Symmetries.from_bop(info)
    number = re.fullmatch(r"obj_(\d+)", mesh.stem)
    whole = mesh.with_name("models_info.json")
    if number and whole.is_file():
        return Symmetries.from_bop(_object(whole).get(str(int(number[1])), {}))
    return Symmetries()


def _object(path: Path) -> dict[str, Any]:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise InputError(f"{path} cannot be read as JSON: {error}.") from error
    if not isinstance(content, dict):
        raise InputError(f"{path} must hold one JSON object in braces.")
    return content
