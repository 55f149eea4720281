"""Command-line options for the paper's detection by seeds, from the fields of its configuration.

Never knows what a setting does; names, types, defaults and texts are those of `config`.
"""

from __future__ import annotations

import argparse
import typing
from dataclasses import replace
from typing import Any

from ..config import LoopConfig, SeedDetectorConfig
from .settings import fields_of, hide, metavar, shown

DEST = "seeds."
# Options that are wanted often go without the prefix.
SHORT = ("sizes", "poses", "sinks", "rotations", "seed", "criterion")


def add_seed_options(parser: argparse.ArgumentParser, base: SeedDetectorConfig) -> None:
    """An option for each field but those of the loop; `base` are the defaults that help shows."""
    group = parser.add_argument_group("method seeds")
    for name, kind, text, value in fields_of(base):
        if "." in name:  # the loop's: `add_settings` has them
            continue
        action = group.add_argument(
            f"--{name}" if name in SHORT else f"--seeds.{name}",
            dest=DEST + name,
            default=argparse.SUPPRESS,
            help=f"{text} (default: {shown(value)})",
            **_reading(kind, value),
        )
        if name not in SHORT:
            hide(action)


def seeds_of(
    args: argparse.Namespace, base: SeedDetectorConfig, loop: LoopConfig
) -> SeedDetectorConfig:
    """The configuration that the options ask for, with `base` where they say nothing."""
    given: dict[str, Any] = {
        name.removeprefix(DEST): tuple(value) if isinstance(value, list) else value
        for name, value in vars(args).items()
        if name.startswith(DEST)
    }
    return replace(base, **given, loop=loop)


def given_seed_options(args: argparse.Namespace) -> list[str]:
    """Which of these options are given, as they are written."""
    names = [key.removeprefix(DEST) for key in vars(args) if key.startswith(DEST)]
    return [f"--{name}" if name in SHORT else f"--{DEST}{name}" for name in names]


def _reading(kind: Any, value: Any) -> dict[str, Any]:
    """How argparse reads a field: its type, and how many words."""
    if typing.get_origin(kind) is typing.Literal:
        return {"choices": typing.get_args(kind)}
    if isinstance(value, tuple):
        one, *others = typing.get_args(kind)
        words = {"nargs": "+"} if Ellipsis in others else {"nargs": len(value)}
        return {"type": one, "metavar": metavar(one), **words}
    return {"type": kind, "metavar": metavar(kind)}
