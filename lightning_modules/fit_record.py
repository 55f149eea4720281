"""What a fit goes by, written beside its checkpoint: a folder goes on with one fit alone.

Never knows an option by itself.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from moveit6d.errors import InputError
from moveit6d.io import read_json, write_json

RECORD = "fit.json"


def claim(folder: Path, facts: Mapping[str, Any]) -> None:
    """Write down what the fit in a folder goes by, if none has left a checkpoint there.

    `InputError` if one has that goes by something else. One that has left no record is taken for
    the same, and so is what a record does not name: both are of an earlier version.
    """
    path, checkpoint = folder / RECORD, next(folder.glob("last*.ckpt"), None)
    now = json.loads(json.dumps(dict(_flat(facts))))
    if checkpoint is None:
        write_json(path, now)
        return
    before = read_json(path) if path.is_file() else {}
    other = [name for name, value in now.items() if before.get(name, value) != value]
    if other:
        names = ", ".join(other[:3]) + (" and more" if len(other) > 3 else "")
        raise InputError(
            f"{folder} holds the checkpoint of a fit with another {names}; give that fit's "
            f"options, or another --output (and --ckpt_path {checkpoint} to go on from it there)."
        )


def _flat(facts: Mapping[str, Any]) -> Iterator[tuple[str, Any]]:
    """Every value by its dotted name."""
    for name, value in facts.items():
        if isinstance(value, Mapping):
            yield from ((f"{name}.{part}", inner) for part, inner in _flat(value))
        else:
            yield name, value
