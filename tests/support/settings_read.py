"""Which settings a run reads, to compare them with the options that its help shows."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any
from unittest.mock import patch

from moveit6d import config
from moveit6d.cli.main import make_parser
from moveit6d.cli.settings import PREFIX, fields_of
from moveit6d.config import TrackerConfig

# Where settings are only checked, compared, copied and written.
FILES = (
    "<string>", "dataclasses.py", "copy.py", "jsonargparse", "cli/settings.py", "config/ranges.py"
)  # fmt: skip
Settings = set[tuple[str, str]]  # class and field
# They decide about scores and covariances, which tracks and detections do not write.
UNWRITTEN: Settings = {("LoopConfig", "width_error"), ("LoopConfig", "displacement_error")}


@contextmanager
def recorded() -> Iterator[Settings]:
    """The settings that are read in the block."""
    found: Settings = set()
    with ExitStack() as stack:
        for kind in _kinds():
            stack.enter_context(patch.object(kind, "__getattribute__", _reader(kind, found)))
        yield found


def offered(*verbs: str) -> Settings:
    """The settings for which a verb, or an inner one, has an option."""
    parser: Any = make_parser()
    for verb in verbs:
        (inner,) = (one for one in parser._actions if isinstance(one.choices, dict))
        parser = inner.choices[verb]
    names = {
        action.dest.removeprefix(PREFIX)
        for action in parser._actions
        if action.dest.startswith(PREFIX)
    }
    places = _places(TrackerConfig())
    assert {name for name, *_ in fields_of(TrackerConfig())} == places.keys()
    return {places[name] for name in names}


def _kinds() -> list[type[Any]]:
    named = (getattr(config, name) for name in config.__all__)
    return [one for one in named if isinstance(one, type) and dataclasses.is_dataclass(one)]


def _reader(kind: type[Any], found: Settings) -> Any:
    names = {field.name for field in dataclasses.fields(kind)}

    def read(self: Any, name: str) -> Any:
        value = object.__getattribute__(self, name)
        if name in names and not dataclasses.is_dataclass(value):
            code = sys._getframe(1).f_code
            copied = any(part in code.co_filename for part in FILES)
            if not copied and code.co_name != "__post_init__":
                found.add((kind.__name__, name))
        return value

    return read


def _places(owner: Any, prefix: str = "") -> dict[str, tuple[str, str]]:
    """The class and field of each setting by its dotted name."""
    found = {}
    for field in dataclasses.fields(owner):
        value = getattr(owner, field.name)
        if dataclasses.is_dataclass(value):
            found |= _places(value, f"{prefix}{field.name}.")
        else:
            found[prefix + field.name] = (type(owner).__name__, field.name)
    return found
