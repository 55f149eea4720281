"""What kind of value each setting takes, and the refusal of other ones.

Never looks at how large a value is: `ranges` does.
"""

from __future__ import annotations

import dataclasses
import sys
import typing
from functools import cache
from numbers import Integral, Real
from types import NoneType, UnionType
from typing import Any

from ..errors import InputError

# What the numbers of other libraries are, too.
_PLAIN: dict[Any, tuple[str, Any]] = {
    bool: ("True or False", bool),
    int: ("a whole number", Integral),
    float: ("a number", Real),
    NoneType: ("None", NoneType),
}


@cache  # every configuration is checked when it is made
def kinds_of(configuration: type) -> dict[str, Any]:
    """The type of every field of a configuration's class, by its name."""
    return typing.get_type_hints(configuration, vars(sys.modules[configuration.__module__]))


def check_types(config: Any, name: str = "") -> None:
    """Refuse a configuration whose fields, or those inside of them, hold another kind of value.

    Of numbers, truth values and configurations; the `InputError` names field and value. `name` is
    that of the configuration in its messages, its class if empty.
    """
    name = name or type(config).__name__
    kinds = kinds_of(config.__class__)
    for field in dataclasses.fields(config):
        value, kind = vars(config)[field.name], kinds[field.name]
        _check(value, kind, f"{name}.{field.name}")
        if dataclasses.is_dataclass(value):
            check_types(value, f"{name}.{field.name}")


def _check(value: Any, kind: Any, name: str) -> None:
    options = typing.get_args(kind) if isinstance(kind, UnionType) else (kind,)
    if not all(option in _PLAIN or dataclasses.is_dataclass(option) for option in options):
        return
    if any(_is(value, option) for option in options):
        return
    wanted = " or ".join(
        _PLAIN[one][0] if one in _PLAIN else f"a {one.__name__}" for one in options
    )
    raise InputError(f"{name} must be {wanted}, found {value!r}.")


def _is(value: Any, option: Any) -> bool:
    accepted = _PLAIN[option][1] if option in _PLAIN else option
    # A truth value counts as a whole number in Python, and means none here.
    return isinstance(value, accepted) and (isinstance(value, bool) <= (option is bool))
