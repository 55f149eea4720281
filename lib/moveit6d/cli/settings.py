"""Command-line options for every field of a configuration, and --config for a file of them.

Never knows what a setting does; names, types, defaults and texts are those of `config`.
"""

from __future__ import annotations

import argparse
import dataclasses
import re
import types
import typing
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..checks import reading
from ..checks import shown as shown_value
from ..config import TrackerConfig
from ..config.types import kinds_of
from ..errors import InputError
from ..io import read_text

# Options that are wanted often, beside the full name.
SHORT = {
    "loop.mode": "--mode",
    "loop.max_iterations": "--max_iterations",
    "recovery.max_milliseconds": "--max_milliseconds",
}
OFF = {
    "multi_start.enabled": ("--no_multi_start", "no refinement from perturbed starts"),
    "contour.enabled": ("--no_contour", "no contour refinement"),
    "calibration.enabled": ("--no_calibration", "no calibration from an exact first pose"),
    "recovery.enabled": ("--no_recovery", "never look for lost objects"),
}
DEFAULT = TrackerConfig()


@dataclass(frozen=True)
class SettingsPart:
    """The settings that a verb reads, by their dotted names or those of their groups.

    Those in `but` are not among them.
    """

    names: tuple[str, ...]
    but: tuple[str, ...] = ()

    def __contains__(self, name: str) -> bool:
        return _is_in(name, self.names) and not _is_in(name, self.but)


EVERYTHING = SettingsPart(tuple(field.name for field in dataclasses.fields(TrackerConfig)))
PREFIX = "setting:"  # of the names under which argparse keeps them
_FULL_HELP = "full_help"  # attribute of the options that only --all_options shows


class AllOptions(argparse.Action):
    """The help with every setting; --help shows those that are wanted often."""

    def __init__(self, option_strings: Sequence[str], dest: str, **options: Any) -> None:
        super().__init__(option_strings, argparse.SUPPRESS, nargs=0, **options)

    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        """Print and end, as --help does."""
        parser.usage = parser.format_usage().partition("usage: ")[2].strip()  # without them
        for action in parser._actions:
            action.help = getattr(action, _FULL_HELP, action.help)
        parser.print_help()
        parser.exit()


def hide(action: argparse.Action) -> None:
    """Leave an option to --all_options."""
    setattr(action, _FULL_HELP, action.help)
    action.help = argparse.SUPPRESS


def add_settings(
    parser: argparse.ArgumentParser, base: TrackerConfig = DEFAULT, part: SettingsPart = EVERYTHING
) -> None:
    """Add --config and an option for each field of a part; `base` are the defaults of the help."""
    parser.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="settings as a YAML file, nested as the options below; these go before it. It may "
        "hold those of other commands, too",
    )
    parser.add_argument(
        "--all_options",
        action=AllOptions,
        default=argparse.SUPPRESS,
        help="show this help with every setting that this command reads",
    )
    group = parser.add_argument_group(
        "settings",
        "All of them (--all_options) are written with the results. Tuples as '[1, 2]'.",
    )
    for name, kind, text, value in fields_of(base):
        if name not in part:
            continue
        options = [f"--{name}", *([SHORT[name]] if name in SHORT else [])]
        action = group.add_argument(
            *options,
            dest=PREFIX + name,
            metavar=metavar(kind),
            default=argparse.SUPPRESS,
            help=f"{text} (default: {shown(value)})".replace("%", "%%"),
        )
        if "." in name and name not in SHORT:
            hide(action)
        if name in OFF:
            option, text = OFF[name]
            group.add_argument(
                option,
                dest=PREFIX + name,
                action="store_const",
                const="false",
                default=argparse.SUPPRESS,
                help=f"{text}: the same as --{name} false",
            )


def settings_of(args: argparse.Namespace, base: TrackerConfig = DEFAULT) -> TrackerConfig:
    """The configuration that the options ask for, with `base` where they say nothing.

    `InputError` names the option or the file that cannot be used.
    """
    given = _given(args)
    file: Path | None = getattr(args, "config", None)
    if not given and file is None:
        return base
    if file is not None and not file.is_file():
        raise InputError(f"{file} does not exist; --config takes a YAML file of settings.")
    import jsonargparse

    parser = jsonargparse.ArgumentParser(exit_on_error=False)
    parser.add_class_arguments(TrackerConfig, None)
    parser.set_defaults(_flat(base.as_dict()))
    if file is not None:
        parser.set_defaults(_in_file(file, parser))
    try:
        found = parser.instantiate(
            parser.parse_args([f"--{name}={value}" for name, value in given.items()])
        )
    except (argparse.ArgumentError, jsonargparse.ArgumentError) as error:
        raise InputError(_sentence(str(error), None)) from None
    values = {field.name: found[field.name] for field in dataclasses.fields(TrackerConfig)}
    return TrackerConfig(**values)


def check_settings(args: argparse.Namespace, part: SettingsPart, way: str) -> None:
    """`InputError` for options of settings that one way of a verb does not read."""
    others = [f"--{name}" for name in _given(args) if name not in part]
    if others:
        raise InputError(f"{', '.join(others)} changes nothing {way}; leave it out.")


def _given(args: argparse.Namespace) -> dict[str, Any]:
    """The settings that options ask for, by dotted name."""
    every = vars(args).items()
    return {key.removeprefix(PREFIX): value for key, value in every if key.startswith(PREFIX)}


def _is_in(name: str, names: Sequence[str]) -> bool:
    return any(name == one or name.startswith(f"{one}.") for one in names)


def fields_of(config: Any, prefix: str = "") -> Iterator[tuple[str, Any, str, Any]]:
    """Dotted name, type, text and value of every field of a configuration and those inside it."""
    kinds = kinds_of(config.__class__)
    texts = argument_texts(type(config))
    for field in dataclasses.fields(config):
        name, value = prefix + field.name, getattr(config, field.name)
        if dataclasses.is_dataclass(value):
            yield from fields_of(value, f"{name}.")
        else:
            yield name, kinds[field.name], texts[field.name], value


def argument_texts(kind: type) -> dict[str, str]:
    """What a class's docstring says of each of its `Args`."""
    block = (kind.__doc__ or "").partition("Args:\n")[2].partition("\n\n")[0]
    found: dict[str, str] = {}
    for line in block.splitlines():
        start = re.match(r"        (\w+): (.*)", line)
        if start:
            name = start[1]
            found[name] = start[2]
        elif line.strip() and found:
            found[name] += " " + line.strip()
    return {name: text.rstrip(".") for name, text in found.items()}


def metavar(kind: Any) -> str:
    """How help shows a type."""
    if typing.get_origin(kind) in (typing.Union, types.UnionType):
        kind = next(one for one in typing.get_args(kind) if one is not type(None))
    if typing.get_origin(kind) is typing.Literal:
        return "{" + ",".join(map(str, typing.get_args(kind))) + "}"
    names = {int: "N", float: "X", bool: "BOOL", str: "NAME"}
    return names.get(kind, "LIST")


def shown(value: Any) -> str:
    """How help shows a default."""
    if isinstance(value, tuple):
        return "[" + ", ".join(map(shown, value)) + "]"
    return str(value).lower() if isinstance(value, bool) else str(value)


def _in_file(file: Path, parser: Any) -> dict[str, Any]:
    """Every setting by dotted name: what a YAML file says, the parser's defaults elsewhere."""
    import jsonargparse
    from jsonargparse.typing import Path_fr

    text = read_text(file)
    try:
        # Files that it names lie beside it.
        with reading(file, "settings"), Path_fr(str(file)).relative_path_context():
            settings = parser.parse_string(text).clone(with_meta=False)
            found = _flat(settings.as_dict())
    except (argparse.ArgumentError, jsonargparse.ArgumentError) as error:
        raise InputError(_sentence(str(error), file)) from None
    known = {name for name, *_ in fields_of(DEFAULT)}
    for name, value in found.items():
        if name not in known:  # a group of settings, which the parser takes for anything
            raise InputError(
                f"{file}: {name} must be settings by name, nested as the options are, found "
                f"{shown_value(value)}."
            )
    return found


def _flat(values: dict[str, Any], prefix: str = "") -> dict[str, Any]:
    """Nested settings by dotted name."""
    found: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, dict):
            found |= _flat(value, f"{prefix}{name}.")
        else:
            found[prefix + name] = value
    return found


def _sentence(text: str, file: Path | None) -> str:
    """One sentence from the parser's report."""
    where = "the settings" if file is None else str(file)
    key = re.search(r'[Kk]ey "([\w.]+)"', text)
    value = re.search(r"(?:Given|Got) value: (.*)", text)
    known = {name: kind for name, kind, _, _ in fields_of(DEFAULT)}
    if key and value and key[1] in known:
        kind = str(known[key[1]]).replace("typing.", "")
        kind = getattr(known[key[1]], "__name__", kind) if "[" not in kind else kind
        begin = "Setting" if file is None else f"{file}: setting"
        return f"{begin} {key[1]} must be {kind}, found {value[1].strip()!r}."
    if text.startswith("Unexpected config"):  # goes on with all of it
        return f"{where} holds no settings; they are names and values, nested as the options are."
    lines = [line.strip() for line in text.splitlines() if line.strip()]
    return f"{where}: {' '.join(lines[:2])}"
